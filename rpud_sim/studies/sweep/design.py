"""Design of an experiment: the points of a sweep in the space of the swept parameters."""

from __future__ import annotations

import numpy as np
from scipy.stats import qmc

from rpud_sim.studies.sweep.specification import Specification


def design_points(specification: Specification) -> dict[str, np.ndarray]:
    """Return the points of a sweep: by swept parameter its values, shape (points,), SI units.

    In a grid the last parameter changes fastest. Latin hypercubes and (scrambled) Sobol sequences
    are SciPy's, with the seed of the specification.
    """
    swept = specification.swept
    count = specification.point_count
    if specification.design == "grid":
        levels = [item.levels() for item in swept.values()]
        indices = np.unravel_index(np.arange(count), [len(values) for values in levels])
        return {
            name: values[index] for name, values, index in zip(swept, levels, indices, strict=True)
        }
    # Every version of SciPy accepts a generator by this name.
    random = np.random.default_rng(specification.seed)
    if specification.design == "sobol":
        shares = qmc.Sobol(len(swept), seed=random).random_base2(count.bit_length() - 1)
    else:
        shares = qmc.LatinHypercube(len(swept), seed=random).random(count)
    return {name: item.at(shares[:, i]) for i, (name, item) in enumerate(swept.items())}
