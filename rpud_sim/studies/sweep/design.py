"""Design of an experiment: the points of a sweep in the space of all that changes."""

from __future__ import annotations

import numpy as np
from scipy.stats import qmc

from rpud_sim.studies.sweep.indices import saltelli_shares
from rpud_sim.studies.sweep.specification import SweepSpecification


def design_points(specification: SweepSpecification) -> dict[str, np.ndarray]:
    """Return the points of a sweep: by axis its values, shape (points,), SI units.

    Cases change slowest, then faults; each has the whole design. In a grid the last parameter
    changes fastest. Latin hypercubes and (scrambled) Sobol sequences are SciPy's, with the seed of
    the specification.
    """
    design = _swept_points(specification)
    axes = specification.axes
    outer = {name: item.levels() for name, item in axes.items() if name not in design}
    shape = [*map(len, outer.values()), specification.design_count]
    *levels, inner = np.unravel_index(np.arange(specification.point_count), shape)
    return {
        **{name: outer[name][level] for name, level in zip(outer, levels, strict=True)},
        **{name: values[inner] for name, values in design.items()},
    }


def _swept_points(specification: SweepSpecification) -> dict[str, np.ndarray]:
    swept = specification.swept
    count = specification.design_count
    if specification.design == "grid":
        levels = [item.levels() for item in swept.values()]
        if not levels:
            return {}
        indices = np.unravel_index(np.arange(count), [len(values) for values in levels])
        return {
            name: values[index] for name, values, index in zip(swept, levels, indices, strict=True)
        }
    points, seed = specification.points or 0, specification.seed
    if specification.design == "saltelli":
        shares = saltelli_shares(len(swept), points, seed).reshape(count, len(swept))
    elif specification.design == "sobol":
        # Every version of SciPy accepts a generator by this name.
        sequence = qmc.Sobol(len(swept), seed=np.random.default_rng(seed))
        shares = sequence.random_base2(points.bit_length() - 1)
    else:
        shares = qmc.LatinHypercube(len(swept), seed=np.random.default_rng(seed)).random(count)
    return {name: item.at(shares[:, i]) for i, (name, item) in enumerate(swept.items())}
