"""The drives: a row each, see ``drives.drive``."""

from workbench.arena.drives.drive import Drive
from workbench.arena.drives.planar import PLANAR
from workbench.arena.drives.rolling import ROLLING
from workbench.arena.drives.wheels import WHEELS
from workbench.compiled import chosen

_ROWS: tuple[Drive, ...] = (WHEELS, PLANAR, ROLLING)
DRIVES = {drive.name: drive for drive in _ROWS}
DRIVE_NUMBERS = {drive.name: number for number, drive in enumerate(_ROWS)}  # of MOTORS.drive
read = chosen([drive.read for drive in _ROWS])
