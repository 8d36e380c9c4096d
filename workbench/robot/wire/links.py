"""Bytes to and from a robot: a serial port or a TCP socket, with a deadline on everything.

Contract: reading returns exactly what was asked for or raises: LinkTimeout when the rest does not
come in time, LinkLost when the link is gone. Writing raises LinkTimeout when the other end takes
nothing. No call blocks longer than its time-out.
"""

import math
import select
import socket
from abc import ABC, abstractmethod

import serial

from workbench.robot.clock import CLOCK, Clock
from workbench.robot.faults import BadReply, LinkLost, LinkTimeout

LONGEST_LINE = 4096  # bytes


class Link(ABC):
    """A two-way channel of bytes.

    Args:
        timeout_s: for one reply, and for one write.
        clock: the time that it goes by.

    Attributes:
        until: moment of the clock beyond which no reply is waited for.
    """

    def __init__(self, timeout_s: float, clock: Clock = CLOCK) -> None:
        self.timeout_s = timeout_s
        self.clock = clock
        self.until = math.inf
        self._buffer = bytearray()

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send all bytes."""

    @abstractmethod
    def _receive(self, timeout_s: float) -> bytes:
        """Return what is there after at most timeout_s, b"" if nothing came."""

    @abstractmethod
    def close(self) -> None:
        """Close the channel; never raises."""

    @abstractmethod
    def fileno(self) -> int:
        """Return the descriptor of the channel, for ``select``."""

    def patience(self, seconds: float) -> None:  # noqa: B027  (only a guardian needs it)
        """Announce that nothing will be said for so long."""

    def read(self, count: int, timeout_s: float | None = None) -> bytes:
        """Return exactly ``count`` bytes."""
        self._fill(lambda: len(self._buffer) >= count, timeout_s, f"{count} bytes")
        data = bytes(self._buffer[:count])
        del self._buffer[:count]
        return data

    def read_line(self, timeout_s: float | None = None) -> bytes:
        """Return the next line without its end."""
        self._fill(
            lambda: b"\n" in self._buffer or len(self._buffer) > LONGEST_LINE, timeout_s, "a line"
        )
        if b"\n" not in self._buffer:
            self._buffer.clear()
            raise BadReply(
                f"more than {LONGEST_LINE} bytes without an end of line; is this an e-puck, "
                "at this baud rate?"
            )
        line, _, rest = bytes(self._buffer).partition(b"\n")
        self._buffer[:] = rest
        return line.rstrip(b"\r")

    def arrived(self) -> bytearray:
        """Return what has come in and nobody has read, to take from."""
        for _ in range(64):
            more = self._receive(0.0)
            if not more:
                break
            self._buffer += more
        return self._buffer

    def drain(self) -> None:
        """Forget all that has come in, such as a reply that came too late."""
        self._buffer.clear()
        for _ in range(64):
            if not self._receive(0.0):
                return
        raise BadReply(
            "the other end sends without being asked; is this an e-puck, at this baud rate?"
        )

    def _fill(self, enough: object, timeout_s: float | None, wanted: str) -> None:
        begun = self.clock.now()
        deadline = min(begun + (self.timeout_s if timeout_s is None else timeout_s), self.until)
        while not enough():  # type: ignore[operator]  # a function without arguments
            left = deadline - self.clock.now()
            if left <= 0:
                raise LinkTimeout(
                    f"expected {wanted} within {max(0.0, deadline - begun):.3g} s, got "
                    f"{bytes(self._buffer[:40])!r}"
                )
            self._buffer += self._receive(left)


class SerialLink(Link):
    """A serial port.

    Args:
        port: for example /dev/ttyS0.
        baud: 115200 (Bluetooth), 230400 (Overo).
        timeout_s: see Link.
    """

    def __init__(
        self, port: str, baud: int, *, timeout_s: float = 0.25, clock: Clock = CLOCK
    ) -> None:
        super().__init__(timeout_s, clock)
        try:
            self._port = serial.Serial(
                port, baud, timeout=0, write_timeout=timeout_s, exclusive=True
            )
        except (serial.SerialException, OSError, ValueError) as error:
            raise LinkLost(
                f"serial port {port!r} at {baud} baud cannot be opened: {error}"
            ) from error

    def write(self, data: bytes) -> None:
        try:
            self._port.write(data)
        except serial.SerialTimeoutException as error:
            raise LinkTimeout(f"the serial port took nothing for {self.timeout_s:g} s") from error
        except (serial.SerialException, OSError, TypeError) as error:
            raise LinkLost(f"the serial port is gone: {error}") from error

    def _receive(self, timeout_s: float) -> bytes:
        try:
            ready, _, _ = select.select([self._port.fileno()], [], [], timeout_s)
            return bytes(self._port.read(4096)) if ready else b""
        except (serial.SerialException, OSError, TypeError, ValueError) as error:
            raise LinkLost(f"the serial port is gone: {error}") from error

    def fileno(self) -> int:
        return int(self._port.fileno())

    def close(self) -> None:
        try:
            self._port.close()
        except OSError:
            pass  # it was gone before


class TcpLink(Link):
    """A TCP socket.

    Args:
        host, port: of the robot; an e-puck2 listens on port 1000.
        timeout_s: see Link.
    """

    def __init__(
        self, host: str, port: int, *, timeout_s: float = 0.25, clock: Clock = CLOCK
    ) -> None:
        super().__init__(timeout_s, clock)
        try:
            self._socket = socket.create_connection((host, port), timeout=max(timeout_s, 0.8))
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            self._socket.settimeout(timeout_s)
        except (OSError, UnicodeError) as error:
            raise LinkLost(f"nothing answers at {host}:{port}: {error}") from error

    def write(self, data: bytes) -> None:
        try:
            self._socket.settimeout(self.timeout_s)
            self._socket.sendall(data)
        except TimeoutError as error:
            raise LinkTimeout(f"the socket took nothing for {self.timeout_s:g} s") from error
        except OSError as error:
            raise LinkLost(f"the connection is gone: {error}") from error

    def _receive(self, timeout_s: float) -> bytes:
        return self.receive_from(self._socket, timeout_s)

    @staticmethod
    def receive_from(channel: socket.socket, timeout_s: float) -> bytes:
        """Return what comes over a socket within some time."""
        try:
            ready, _, _ = select.select([channel], [], [], timeout_s)
            if not ready:
                return b""
            data = channel.recv(65536)
        except (OSError, ValueError) as error:
            raise LinkLost(f"the connection is gone: {error}") from error
        if not data:
            raise LinkLost("the robot closed the connection")
        return data

    def fileno(self) -> int:
        return self._socket.fileno()

    def close(self) -> None:
        try:
            self._socket.close()
        except OSError:
            pass  # it was gone before
