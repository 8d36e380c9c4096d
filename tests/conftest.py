"""Tests never show progress bars and never write into figures/."""

import os

os.environ["WORKBENCH_STATIC"] = "1"
os.environ["WORKBENCH_QUICK"] = "1"

from hypothesis import settings  # noqa: E402  (the environment is set first)

settings.register_profile("workbench", deadline=None, derandomize=True, database=None)  # compiling counts in no deadline
settings.load_profile("workbench")
