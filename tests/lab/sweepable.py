"""Functions that worker processes of the sweep tests import."""

import functools
import hashlib
import math
import os
import time
from dataclasses import dataclass
from pathlib import Path

from workbench.lab.runs import learn


def sleep(seconds):
    time.sleep(seconds)
    return seconds


def note(config):
    with open(config["log"], "a") as log:
        log.write(f"{config['value']}\n")
    return {"value": config["value"], "nan": math.nan}


def refuse_even(number):
    if number % 2 == 0:
        raise ValueError(f"{number} is even")
    return number


def die_at_four(number):
    if number == 4:
        os._exit(1)
    return number


def pid(_):
    return os.getpid()


def learn_a_little(config):
    run = learn(config, steps=300, progress=False)
    return {
        "seed": config.seed,
        "theta": hashlib.sha256(run.policy.theta.tobytes()).hexdigest(),
        "losses": run.summary["losses"],
    }


def sign_in(config):
    Path(config["folder"], str(os.getpid())).touch()
    return config["number"]


def leave(number):
    if number == 2:
        raise SystemExit("bye")
    return number


class Stubborn(Exception):
    def __init__(self, first, second):
        super().__init__(f"the real reason {first} {second}")


def raise_what_cannot_be_read_back(number):
    if number == 2:
        raise Stubborn(1, 2)
    return number


def return_a_set(number):
    return {number} if number == 2 else number


@dataclass(frozen=True)
class Point:
    x: int

    def scaled(self, by):
        return by * self.x


@dataclass(frozen=True)
class Other:
    x: int


def _twice(function):
    @functools.wraps(function)
    def inner(x):
        return 2 * function(x)

    return inner


decorated = _twice(sleep)
