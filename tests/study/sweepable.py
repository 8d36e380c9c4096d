"""Functions that worker processes of the sweep tests import."""

import hashlib
import math
import os
import time

from workbench.study.runs import learn


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
    return {"seed": config.seed, "theta": hashlib.sha256(run.policy.theta.tobytes()).hexdigest(), "losses": run.summary["losses"]}
