"""Who is beside whom: robots in the order of their places, so that only neighbours are compared.

>>> import numpy as np
>>> order, x = np.arange(3), np.array([0.2, 0.0, 0.1])
>>> sort_by_place(order, x); order.tolist()
[1, 2, 0]

Contract: compiled; written in place.
"""

from typing import Any

from workbench.compiled import compiled


@compiled
def sort_by_place(order: Any, x: Any) -> None:
    """Sort the numbers of robots by their places x, and where these are equal by number; by
    insertion, as little changes from one time to the next.
    """
    for n in range(1, order.size):
        who = order[n]
        place = x[int(who)]
        m = n
        while m > 0:
            other = order[m - 1]
            there = x[int(other)]
            if there < place or (there == place and other < who):
                break
            order[m] = other
            m -= 1
        order[m] = who
