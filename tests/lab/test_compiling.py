"""The bar while something is compiled, and that nothing is left to compile afterwards."""

import subprocess
import sys

from workbench.formation.body import BodyConfig
from workbench.formation.config import ConvoyConfig
from workbench.formation.convoy import Convoy
from workbench.lab import compiling

FIRST = """
import workbench as wb
from workbench.lab import compiling
counted = []
count = compiling._Watch.on_end
compiling._Watch.on_end = lambda self, event: (counted.append(event), count(self, event))
wb.prepare()
print(len(counted))
"""


def _prepare(folder, capfd):
    subprocess.run(
        [sys.executable, "-c", FIRST], check=True, env={"NUMBA_CACHE_DIR": str(folder), "HOME": "/"}
    )
    return capfd.readouterr()


def test_a_bar_shows_at_the_first_time_alone_and_knows_how_long_it_is(tmp_path, capfd):
    first = _prepare(tmp_path, capfd)
    assert "compiling, once" in first.err
    assert 0.8 < int(first.out) / compiling.FUNCTIONS[True] < 1.2
    later = _prepare(tmp_path, capfd)
    assert later.out.strip() == "0" and "compiling" not in later.err


def test_the_lean_loop_is_for_those_who_need_no_more():
    plain = {"drive": "rolling"}, {"followers": 2}, {"reward": "absolute"}, {"state_tiles": (5, 5)}
    assert all(Convoy(ConvoyConfig(**kind), [1], steps=1).plain for kind in plain)
    more = ConvoyConfig(sensing="camera"), ConvoyConfig(body=BodyConfig(slip=0.1))
    assert not any(Convoy(config, [1], steps=1).plain for config in more)
