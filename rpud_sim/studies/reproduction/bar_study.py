"""Comparison of the energy balance, eqs. (20)-(39), in both contact models with the bar."""

from __future__ import annotations

import dataclasses

from rpud_sim.model.parameters import CONTACT_MODELS
from rpud_sim.simulation import Parameters, preset
from rpud_sim.studies.reproduction.elastic_bar import BarImpact, strike
from rpud_sim.studies.reproduction.jobs import Track, gather
from rpud_sim.studies.reproduction.paper_numbers import CONTACT_SPEED
from rpud_sim.studies.reproduction.single_contact import Contact, single_contact

FREE_MASSES = (1e-3, 2e-3, 5e-3, 10e-3, 20e-3, 50e-3)  # [kg]
SPEEDS = (1.0, 2.0, CONTACT_SPEED, 10.0)  # [m/s]


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Results of one blow by all three models."""

    free_mass: float  # [kg]
    impact_velocity: float  # [m/s]
    bar: BarImpact  # the elastic bar
    contacts: dict[str, Contact]  # the energy balance, by contact model


@dataclasses.dataclass(frozen=True)
class BarStudy:
    """Results of all blows."""

    by_mass: list[Comparison]  # comparisons at 5 m/s
    by_speed: list[Comparison]  # comparisons with the free mass of Table 2
    # the bar alone, by its number of elements in part I, with the free mass of Table 2 at 5
    # m/s
    by_elements: dict[int, BarImpact]


def run_bar_study(elements: int, track: Track) -> BarStudy:
    """Return the results of blows with every free mass and at every speed.

    Args:
        elements: in part I of the drill tool.
    """
    base = preset("drilling")
    blows = [(base.replace(free_mass=mass), CONTACT_SPEED, elements) for mass in FREE_MASSES]
    blows += [(base, speed, elements) for speed in SPEEDS if speed != CONTACT_SPEED]
    finer = [elements // 4, elements // 2, elements * 3 // 2]
    blows += [(base, CONTACT_SPEED, number) for number in finer]
    bars = dict(
        zip(blows, gather(lambda blow: strike(*blow), blows, "elastic bar", track), strict=True)
    )

    def compare(parameters: Parameters, speed: float) -> Comparison:
        contacts = {
            model: single_contact(parameters.replace(contact_model=model), speed)
            for model in CONTACT_MODELS
        }
        bar = bars[(parameters, speed, elements)]
        return Comparison(parameters.free_mass, speed, bar, contacts)

    return BarStudy(
        by_mass=[compare(base.replace(free_mass=mass), CONTACT_SPEED) for mass in FREE_MASSES],
        by_speed=[compare(base, speed) for speed in SPEEDS],
        by_elements={
            number: bars[(base, CONTACT_SPEED, number)] for number in sorted([*finer, elements])
        },
    )
