"""Jobs keep their order and their errors."""

import pytest

from validation.jobs import gather, silent


def test_work_keeps_its_order_and_its_errors():
    assert gather(lambda number: number**2, range(50), "", silent) == [n**2 for n in range(50)]
    with pytest.raises(ZeroDivisionError):
        gather(lambda number: 1 / number, [1, 0], "", silent)
