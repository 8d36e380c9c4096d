"""Files: written whole or not at all, without pickle, and with errors that say what to do."""

import json
import resource
import subprocess
import sys

import numpy as np
import pytest

from workbench.lab import storage


def test_npz_and_json_round_trip(tmp_path):
    storage.write_npz(tmp_path / "a.npz", {"x": np.arange(3), "word": np.array("é")})
    back = storage.read_npz(tmp_path / "a.npz")
    assert back["x"].tolist() == [0, 1, 2] and str(back["word"]) == "é"
    storage.write_json(
        tmp_path / "a.json", {"n": np.float64(0.5), "bad": float("nan"), "list": (1, np.int64(2))}
    )
    assert storage.read_json(tmp_path / "a.json") == {"n": 0.5, "bad": None, "list": [1, 2]}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.json", "a.npz"]


def test_equal_contents_give_equal_bytes(tmp_path):
    for name in "ab":
        storage.write_npz(tmp_path / name, {"x": np.arange(5.0)})
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_pickles_and_damaged_files_are_refused(tmp_path):
    np.savez(tmp_path / "p.npz", x=np.array([{}], dtype=object))
    with pytest.raises(ValueError, match="p.npz is not a readable .npz file"):
        storage.read_npz(tmp_path / "p.npz")
    storage.write_npz(tmp_path / "d.npz", {"x": np.arange(1000.0)})
    whole = (tmp_path / "d.npz").read_bytes()
    (tmp_path / "d.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ValueError, match="d.npz is"):
        storage.read_npz(tmp_path / "d.npz")
    with pytest.raises(FileNotFoundError, match="none.npz does not exist"):
        storage.read_npz(tmp_path / "none.npz")
    (tmp_path / "x.json").write_text("{")
    with pytest.raises(ValueError, match="x.json is not valid JSON"):
        storage.read_json(tmp_path / "x.json")


def test_a_failed_write_keeps_the_previous_file(tmp_path):
    storage.write_json(tmp_path / "a.json", {"good": 1})

    class Full(dict):
        def items(self):
            raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space"):
        storage._write(tmp_path / "a.json", lambda file: Full().items())
    assert json.loads((tmp_path / "a.json").read_text()) == {"good": 1}
    assert [path.name for path in tmp_path.iterdir()] == ["a.json"]


_LEARN = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
from workbench.formation.config import ConvoyConfig
from workbench.lab.runs import learn
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), resource.RLIM_INFINITY))
learn(ConvoyConfig(drive="planar"), steps=60_000, out=sys.argv[1], checkpoint_s=0, resume=True)
"""


@pytest.mark.skipif(
    not hasattr(resource, "RLIMIT_FSIZE"), reason="this system cannot limit file sizes"
)
def test_a_full_disk_leaves_the_last_good_checkpoint_and_says_so(tmp_path):
    from workbench.formation.config import ConvoyConfig
    from workbench.lab.runs import learn

    whole = tmp_path / "whole"
    learn(ConvoyConfig(drive="planar"), steps=60_000, out=whole, checkpoint_s=0, progress=False)
    out = tmp_path / "run"
    # the first checkpoints fit below this size, the later ones, which hold more records, do not: a
    # disk that runs full
    first = subprocess.run(
        [sys.executable, "-c", _LEARN, str(out), "1600000"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert first.returncode != 0
    assert (
        "could not write" in first.stderr
        and "the last good checkpoint is kept there" in first.stderr
    )
    assert "Make room, then continue with resume" in first.stderr
    good = storage.read_npz(out / "checkpoint.npz")
    assert 0 < good["convoy.formations"]["updates"][0] < 60_000
    second = subprocess.run(
        [sys.executable, "-c", _LEARN, str(out), "999999999"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert second.returncode == 0, second.stderr
    for name in ("weights.npz", "records.npz", "summary.json", "checkpoint.npz"):
        assert (out / name).read_bytes() == (whole / name).read_bytes(), name
