"""Tests never show progress bars and never write into figures/.

What was left out for want of a program is said at the end.
"""

import os

os.environ["WORKBENCH_STATIC"] = "1"
os.environ["WORKBENCH_QUICK"] = "1"

from hypothesis import settings  # noqa: E402  (the environment is set first)

settings.register_profile(
    "workbench", deadline=None, derandomize=True, database=None
)  # compiling counts in no deadline
settings.load_profile("workbench")


def pytest_collection_modifyitems(items):
    """Begin with the longest test, which waits more than it computes: at the end it would run
    alone.
    """
    items.sort(key=lambda item: "test_browser" not in item.nodeid)


def pytest_terminal_summary(terminalreporter):
    reasons = {
        report.longrepr[2].removeprefix("Skipped: ")
        for report in terminalreporter.stats.get("skipped", [])
    }
    for reason in sorted(reasons):
        terminalreporter.write_line(f"left out: {reason}", yellow=True)
