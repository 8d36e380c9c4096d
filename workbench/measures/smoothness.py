"""Smoothness of one movement: SPARC and LDLJ, and what they are good for.

* ``sparc``: spectral arc length of a speed profile (Balasubramanian et al. 2012, 2015). Negative;
  nearer to zero is smoother. It is blind to how a robot moves at constant speed: a perfect circle
      and a juddering one give the same value, and ripple of the
  speed is invisible below 10 % and then jumps. Use it for movements that begin and end, such as a
  reset manoeuvre.
* ``ldlj``: log dimensionless jerk of a speed profile. Larger is smoother. At constant speed there
  is no jerk to speak of.
* ``ldlj_vector``: the same of a velocity vector (Melendez-Calderon et al. 2021): it sees turning
  too. Use this one for paths, and compare windows of equal length and sampling rate only: it drifts
      by about -4 ln T.

Definitions and values agree with the authors' published Python to 1e-9
(tests/data/smoothness.json).

>>> t = np.arange(-1, 1, 0.01)
>>> round(sparc(np.exp(-5 * t**2), 100.0), 5), round(ldlj(np.exp(-5 * t**2), 100.0), 5)
(-1.41403, -5.81636)

Contract: pure functions of arrays; SI units; the sampling rate fs is in Hz.
"""

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

Floats = NDArray[np.float64]
# zero padding of the spectrum in powers of two; amplitude below which its tail is cut off
_PADDING = 4
_THRESHOLD = 0.05
_ROUNDING = (
    8 * np.finfo(float).eps
)  # a change of the velocity below this part of its peak is no change


def sparc(speed: ArrayLike, fs: float, fc: float = 10.0) -> float:
    """Return the spectral arc length of a speed profile.

    Args:
        speed: (T,) samples in any unit.
        fs: samples per second.
        fc: highest frequency in Hz that counts (the authors' default of 2015; 20 in their first
            paper). It is clamped to fs / 2: above that a spectrum only repeats itself, and counting
            the repetition is wrong.

    Raises:
        ValueError: too few samples, samples that are not finite, all zero, or a frequency that is
            not positive.
    """
    samples = _checked("speed", speed, 1, fs, 2)
    if not fc > 0 or not math.isfinite(fc):
        raise ValueError(f"fc = {fc!r}; expected a frequency above 0 Hz")
    if not np.any(samples):
        raise ValueError(
            f"speed is 0 in all of {samples.size} samples; there is no movement whose "
            "smoothness could be told"
        )
    n = 2 ** (math.ceil(math.log2(samples.size)) + _PADDING)
    magnitude = np.abs(np.fft.fft(samples, n))
    kept = np.arange(n) * fs / n <= min(fc, fs / 2)
    spectrum = (magnitude / magnitude.max())[kept]
    above = np.flatnonzero(spectrum >= _THRESHOLD)
    spectrum = spectrum[above[0] : above[-1] + 1] if above.size else spectrum[:0]
    if spectrum.size < 2:
        raise ValueError(
            f"the spectrum up to fc = {fc!r} Hz has fewer than two lines above "
            f"{_THRESHOLD:g}; raise fc"
        )
    step = 1.0 / (spectrum.size - 1)  # of the normalised frequency
    return -float(np.sum(np.hypot(step, np.diff(spectrum))))


def ldlj(speed: ArrayLike, fs: float) -> float:
    """Return the log dimensionless jerk of a speed profile (T,); infinite at constant speed, where
    nothing but round-off is left.

    Raises:
        ValueError: fewer than three samples, samples that are not finite, or all zero.
    """
    samples = _checked("speed", speed, 1, fs, 3)
    return _log_jerk(samples[:, None], fs)


def ldlj_vector(velocity: ArrayLike, fs: float) -> float:
    """Return the log dimensionless jerk of a velocity (T, d), for example (T, 2) in m/s; infinite
    at constant velocity.

    Raises:
        ValueError: fewer than three samples, samples that are not finite, or all zero.
    """
    return _log_jerk(_checked("velocity", velocity, 2, fs, 3), fs)


def _log_jerk(velocity: Floats, fs: float) -> float:
    duration = len(velocity) / fs
    peak = float(np.max(np.linalg.norm(velocity, axis=1)))
    if peak == 0.0:
        raise ValueError(
            f"the velocity is 0 in all of {len(velocity)} samples; there is no movement to be "
            "told smooth"
        )
    change = np.linalg.norm(np.diff(velocity / peak, n=2, axis=0), axis=1)
    if np.all(change <= _ROUNDING):
        return math.inf
    return -math.log(duration**3 * float(np.sum((change * fs**2) ** 2)) / fs)


def _checked(name: str, values: ArrayLike, dimensions: int, fs: float, least: int) -> Floats:
    samples = np.asarray(values, dtype=np.float64)
    if not fs > 0 or not math.isfinite(fs):
        raise ValueError(f"fs = {fs!r}; expected samples per second, above 0")
    if samples.ndim != dimensions or len(samples) < least:
        shape = "(T,)" if dimensions == 1 else "(T, d)"
        raise ValueError(
            f"{name} has shape {samples.shape}; expected {shape} with at least {least} samples"
        )
    if not np.all(np.isfinite(samples)):
        raise ValueError(
            f"{int((~np.isfinite(samples)).sum())} numbers of {name} are not finite; cut the "
            "gaps out"
        )
    return samples
