"""SerCom, the e-puck1's serial protocol, as pure functions of bytes, and a table of where its
variants differ.

Source: gctronic/e-puck-library, program/DemoGCtronic-complete/Asercom.c. ASCII: ``D,300,-300`` +
CR, replies a lower-case letter, a comma list and CRLF. Binary: byte 256 - ord(letter) for every
command, chained, ended by 0x00; replies are 16-bit little-endian numbers, one after the other,
without a checksum. A binary chain without its 0x00 leaves the robot deaf to ASCII until one comes.

>>> ascii_request("D", 300, -300), binary_request(("D", 300, -300), ("N",)).hex()
(b'D,300,-300\\r', 'bc2c01d4feb200')
>>> ascii_numbers(b"q,120,-4", "q", (2,))
(120, -4)

Contract: decoders return numbers in range or raise BadReply with what came; they never guess.
"""

import re
import struct
from dataclasses import dataclass

from workbench.robot.faults import BadReply

ADC = 4095


@dataclass(frozen=True)
class Variant:
    """What differs between the firmwares.

    Attributes:
        baud: of the link.
        infrared: values in a reply to N and O; the first eight are the ring.
        floor_ascii: values in a reply to M, 0: the firmware stays silent.
        floor_binary: the same for binary M.
        lights: whether the body and the front light are there.
        battery: whether it tells of its battery; BTcom takes ``b`` for the body light.
        floor_ascii_garbled: whether bytes from 128 on are sign-extended in the reply to M, so that
            only the binary one can be read.
        bus: whether the robot's I2C bus can be read and written, and a range-and-bearing board on
            it.
    """

    name: str
    baud: int
    infrared: int
    floor_ascii: int
    floor_binary: int
    lights: bool
    battery: bool = True
    floor_ascii_garbled: bool = False
    bus: bool = False


VARIANTS = {
    "epuck1": Variant("epuck1", 115200, 8, 5, 5, True, bus=True),  # UART1, Bluetooth
    "epuck1-bt": Variant(  # BTcom sends three values
        "epuck1-bt", 115200, 8, 3, 3, True, battery=False, floor_ascii_garbled=True
    ),
    "overo": Variant(
        "overo", 230400, 10, 0, 0, False
    ),  # selector 10: the I2C bus with the ground sensors belongs to Linux
}
BTCOM = "Version 1.1.3"  # by which BTcom names itself; it tells of no hardware


def variant_of(version: str, *, variant: str) -> str:
    """Return the variant that a robot is, by its answer to ``V``.

    Args:
        version: that answer.
        variant: by which it was asked: what the answer does not tell is as it was.
    """
    if BTCOM in version:
        return "epuck1-bt"
    return "epuck1" if variant == "epuck1-bt" else variant


READS = {  # sensor: letter, fields of a 16-bit reply (None: as the variant has), struct code
    "proximity": ("N", None, "H"),
    "light": ("O", None, "H"),
    "floor": ("M", None, "H"),
    "motor_speed": ("E", 2, "h"),
    "motor_position": ("Q", 2, "h"),
    "accelerometer": ("a", 3, "h"),
}


def ascii_request(letter: str, *numbers: int) -> bytes:
    """Return a command line."""
    return ",".join([letter, *(str(int(number)) for number in numbers)]).encode("ascii") + b"\r"


def ascii_numbers(line: bytes, letter: str, counts: tuple[int, ...]) -> tuple[int, ...]:
    """Return the whole numbers of a reply line that must begin with a letter and have one of
    several numbers of fields.

    Raises:
        BadReply: another letter, another number of fields, or a field that is no number of 16 bits.
    """
    shown = bytes(line[:60])
    try:
        first, *fields = line.decode("ascii").split(",")
        numbers = tuple(int(field) for field in fields)
    except ValueError:
        raise BadReply(f"expected '{letter},…' with whole numbers, got {shown!r}") from None
    if (
        first != letter
        or len(numbers) not in counts
        or any(field.strip() != field or "_" in field for field in fields)
    ):
        wanted = " or ".join(str(count) for count in counts)
        raise BadReply(f"expected '{letter}' with {wanted} numbers, got {shown!r}")
    if any(not -32768 <= number <= 65535 for number in numbers):
        raise BadReply(f"expected numbers of 16 bits, got {shown!r}")
    return numbers


def battery(line: bytes) -> int:
    """Return the number of a battery's reply: ``b,1`` or, of newer hardware, ``b,1012 (87%)``.

    Raises:
        BadReply: another reply.
    """
    found = re.fullmatch(rb"b,\s*(\d{1,5})(\s*\(\d+\s*%\))?\s*", line)
    if not found:
        raise BadReply(f"expected 'b' with a number, got {bytes(line[:60])!r}")
    return int(found[1])


def binary_request(*commands: tuple[str | int, ...]) -> bytes:
    """Return a chain of binary commands, each a letter and its 16-bit numbers, ended by 0x00."""
    chain = b""
    for letter, *numbers in commands:
        chain += bytes([256 - ord(str(letter))]) + struct.pack(
            f"<{len(numbers)}h", *(int(number) for number in numbers)
        )
    return chain + b"\x00"


def binary_numbers(data: bytes, code: str) -> tuple[int, ...]:
    """Return the 16-bit numbers of a binary reply; code "H" unsigned, "h" signed."""
    if len(data) % 2:
        raise BadReply(f"expected pairs of bytes, got {len(data)} bytes")
    return struct.unpack(f"<{len(data) // 2}{code}", data)


def check_counts(sensor: str, values: tuple[int, ...]) -> tuple[float, ...]:
    """Return readings of a converter of 12 bits as floats; what a firmware let fall below zero (65
    000 and more) is zero.

    Raises:
        BadReply: a value that no converter of 12 bits gives.
    """
    counts = tuple(0 if -ADC <= value < 0 or value > 65535 - ADC else value for value in values)
    if any(not 0 <= value <= ADC for value in counts):
        raise BadReply(
            f"{sensor} = {values}; expected 0 to {ADC} counts: bytes were lost or garbled"
        )
    return tuple(float(value) for value in counts)
