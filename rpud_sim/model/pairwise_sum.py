"""Sum of values with the bits of ``numpy.sum``, in compiled code."""

from rpud_sim.model.compile import compiled

# Of each of the halves in progress: its number of values, the sum of its first half, and whether
# that is known.
_DEPTH = 64
_HALVES = _DEPTH
_KNOWN = 2 * _DEPTH
# Numbers that a sum needs room for
SUM_ROOM = 3 * _DEPTH


@compiled
def _sum_of_128(values, first, count):
    """Sum of at most 128 values, as NumPy adds them."""
    if count < 8:
        total = -0.0
        for i in range(first, first + count):
            total += values[i]
        return total
    a, b, c, d = values[first], values[first + 1], values[first + 2], values[first + 3]
    e, f, g, h = values[first + 4], values[first + 5], values[first + 6], values[first + 7]
    whole = count - count % 8
    for i in range(first + 8, first + whole, 8):
        a += values[i]
        b += values[i + 1]
        c += values[i + 2]
        d += values[i + 3]
        e += values[i + 4]
        f += values[i + 5]
        g += values[i + 6]
        h += values[i + 7]
    total = ((a + b) + (c + d)) + ((e + f) + (g + h))
    for i in range(first + whole, first + count):
        total += values[i]
    return total


@compiled
def pairwise_sum(values, room):
    """Sum of values in the order of ``numpy.sum``, which halves them until 128 are left.

    A plain sum would round differently, and a run's figures would no longer be those of its bag.

    Args:
        room: for what is in progress, shape (SUM_ROOM,).
    """
    count = len(values)
    first = 0
    depth = 0
    while True:
        while count > 128:
            room[depth] = count
            room[_KNOWN + depth] = 0.0
            half = count // 2
            count = half - half % 8
            depth += 1
        total = _sum_of_128(values, first, count)
        first += count
        depth -= 1
        while depth >= 0 and room[_KNOWN + depth] != 0.0:
            total = room[_HALVES + depth] + total
            depth -= 1
        if depth < 0:
            return total + 0.0  # it begins with zero, so that no sum is -0.0
        room[_HALVES + depth] = total
        room[_KNOWN + depth] = 1.0
        whole = int(room[depth])
        half = whole // 2
        count = whole - (half - half % 8)
        depth += 1
