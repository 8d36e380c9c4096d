"""An emulated robot at the other end of a real wire: SerCom on a pseudo-terminal, e-puck2 packets
on a TCP socket.

    with Emulator(SimulatedRobot(config), "overo") as emulator:
        robot = SerComRobot(emulator.address, variant="overo")

What happens inside is simulated physics, what goes over the wire is the real protocol. In real time
(``rate``) the body moves on whether it is asked or not, as robots do; in lockstep it moves when a
sensor is read again, so that nothing depends on clocks. Either way its world stands until somebody
speaks to it. The wire can be made slow (``baud``), late (``delay_s``) and bad (``fault``).

Contract: one client at a time. ``heard`` keeps what came in, with times, for tests; ``close`` ends
all threads.
"""

import os
import pty
import select
import socket
import threading
import time
import tty
from collections.abc import Callable
from types import TracebackType
from typing import Self

import numpy as np

from workbench.robot.api import Robot
from workbench.robot.geometry import CONTROL_PERIOD
from workbench.robot.wire.firmware import (
    CALIBRATION_S,
    STREAM_S,
    EPuck2Firmware,
    Firmware,
    SerComFirmware,
)
from workbench.robot.wire.sercom import VARIANTS

PROTOCOLS = (*VARIANTS, "epuck2")
SLOWEST = 1e-3
FASTEST = 1e3
HEADER_S = 0.003  # between the first byte of a streamed packet and the rest
FAULTS = ("silent", "short", "split", "garbage", "late", "hang up", "half open", "mute")


class Emulator:
    """A robot on a wire.

    Args:
        robot: the body, not yet connected.
        protocol: one of PROTOCOLS.
        rate: simulated seconds per second; 0 for lockstep.
        baud: speed of the wire in bits/s (ten per byte), both ways; 0 for as fast as it goes.
        delay_s: between a request and its reply.
        port: TCP port on this machine, 0 for a free one.

    Attributes:
        address: what a driver connects to.
        url: the same for ``open_robot``.
        heard: (time, bytes) of everything that came in.
    """

    def __init__(
        self,
        robot: Robot,
        protocol: str = "epuck1",
        *,
        rate: float = 1.0,
        baud: int = 0,
        delay_s: float = 0.0,
        port: int = 0,
    ) -> None:
        if protocol not in PROTOCOLS:
            raise ValueError(f"protocol = {protocol!r}; expected one of {', '.join(PROTOCOLS)}")
        if not (rate == 0 or SLOWEST <= rate <= FASTEST):
            raise ValueError(
                f"rate = {rate!r}; expected 0 for lockstep, or {SLOWEST:g} to {FASTEST:g} "
                "simulated seconds per second"
            )
        if not 0 <= delay_s < 60 or baud < 0:
            raise ValueError(
                f"baud = {baud!r}, delay_s = {delay_s!r}; expected numbers from 0 on, and "
                "less than a minute"
            )
        self.robot = robot
        self.protocol = protocol
        self.rate = rate
        self.baud = baud
        self.delay_s = delay_s
        self._port = port
        self.heard: list[tuple[float, bytes]] = []
        self._faults: list[str] = []
        self._chance = np.random.default_rng(0)
        self._lock = threading.Lock()
        self._leave = threading.Event()
        self._threads: list[threading.Thread] = []
        self._deaf = self._mute = False
        self._rest: tuple[float, bytes] = (
            0.0,
            b"",
        )  # when the second half of a split reply follows

    def __enter__(self) -> Self:
        self.open()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def open(self) -> None:
        """Connect the body and listen."""
        self.robot.connect()
        lockstep = self.rate == 0
        self._firmware: Firmware = (
            EPuck2Firmware(self.robot, lockstep=lockstep)
            if self.protocol == "epuck2"
            else SerComFirmware(self.robot, VARIANTS[self.protocol], lockstep=lockstep)
        )
        self._leave.clear()
        if self.protocol == "epuck2":
            self._listener = socket.create_server(("127.0.0.1", self._port))
            self._listener.settimeout(0.05)
            self.address = f"127.0.0.1:{self._listener.getsockname()[1]}"
            self.url = f"tcp:{self.address}"
            self._start(self._serve_tcp)
        else:
            self._open_pty()
            self._start(self._serve_pty)
        if not lockstep:
            self._start(self._live)

    def close(self) -> None:
        """Hang up, end all threads, stop the body."""
        self._leave.set()
        for thread in self._threads:
            thread.join()
        self._threads.clear()
        if self.protocol == "epuck2":
            self._listener.close()
        else:
            self._close_pty()
        self.robot.disconnect()

    def fault(self, kind: str) -> None:
        """Make the next reply fail.

        Args:
            kind: "silent" no reply; "short" half of it; "split" half of it, and the other half a
                third of a second later; "garbage" random bytes instead; "late" half a second later;
                "hang up" the link ends; "half open" nothing is taken or sent until the next
                connection; "mute" takes everything and answers nothing until the next connection.
        """
        if kind not in FAULTS:
            raise ValueError(f"fault {kind!r}; expected one of {', '.join(FAULTS)}")
        self._faults.append(kind)

    def heal(self) -> None:
        """End all faults."""
        self._faults.clear()
        self._rest = (0.0, b"")
        self._deaf = self._mute = False

    def _start(self, run: Callable[[], None]) -> None:
        thread = threading.Thread(target=run, name=f"emulator {run.__name__}", daemon=True)
        self._threads.append(thread)
        thread.start()

    def _live(self) -> None:
        """Let the body move on in real time."""
        while not self.heard and not self._leave.wait(0.005):
            pass  # it stands until somebody speaks to it
        period = CONTROL_PERIOD / self.rate
        due = time.monotonic() + period
        while not self._leave.wait(max(0.0, due - time.monotonic())):
            with self._lock:
                self._firmware.live()
            due += period

    def _converse(self, data: bytes) -> bytes | None:
        """Return the reply to what came in, after what the wire and the delay take; None to hang
        up.
        """
        self.heard.append((time.monotonic(), data))
        if self._deaf:
            return b""
        due, stalled = self._rest
        if stalled:  # what was held back goes first
            self._leave.wait(max(0.0, due - time.monotonic()))
            self._rest = (0.0, b"")
        with self._lock:
            reply = stalled + self._firmware.feed(data)
        if self._mute:
            return b""
        if self.baud:
            time.sleep(10 * (len(data) + len(reply)) / self.baud)
        if self.delay_s:
            time.sleep(self.delay_s)
        return self._spoil(reply)

    def _spoil(self, reply: bytes) -> bytes | None:
        """Return what the next fault leaves of a reply; None to hang up."""
        if not self._faults or not reply:
            return reply
        kind = self._faults.pop(0)
        if kind == "hang up":
            return None
        if kind in ("half open", "mute"):
            self._deaf = kind == "half open"
            self._mute = kind == "mute"
            return b""
        if kind == "late":
            self._leave.wait(0.5)
            return reply
        if kind == "garbage":
            return bytes(self._chance.integers(0, 256, max(1, len(reply)), dtype=np.uint8).tolist())
        half = len(reply) // 2
        if kind == "split":
            self._rest = (time.monotonic() + 0.35, reply[half:])
        return b"" if kind == "silent" else reply[:half]

    def _overdue(self) -> bytes:
        """Return the second half of a split reply, once its time has come."""
        due, rest = self._rest
        if not rest or time.monotonic() < due:
            return b""
        self._rest = (0.0, b"")
        return rest

    # SerCom on a pseudo-terminal

    def _open_pty(self) -> None:
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(
            self._master, False
        )  # a client that does not read loses what it does not read
        self.address = os.ttyname(self._slave)
        scheme = "overo" if self.protocol == "overo" else "serial"
        self.url = f"{scheme}:{self.address}"
        self.heal()

    def _close_pty(self) -> None:
        for end in (self._master, self._slave):
            try:
                os.close(end)
            except OSError:
                pass  # closed before

    def replug(self) -> None:
        """Make a new terminal, as when a serial adapter is plugged in again; ``address``
        changes.
        """
        self._close_pty()
        self._open_pty()

    def _serve_pty(self) -> None:
        while not self._leave.is_set():
            try:
                ready, _, _ = select.select([self._master], [], [], 0.02)
                data = os.read(self._master, 4096) if ready else b""
            except (OSError, ValueError):
                self._leave.wait(0.01)
                continue
            reply = self._converse(data) if data else self._overdue()
            try:
                if reply is None:
                    self._close_pty()
                elif reply:
                    os.write(self._master, reply)
            except OSError:
                pass  # the terminal is gone; the driver will notice

    # e-puck2 packets on TCP

    def _serve_tcp(self) -> None:
        while not self._leave.is_set():
            try:
                client, _ = self._listener.accept()
            except TimeoutError:
                continue
            self.heal()
            assert isinstance(self._firmware, EPuck2Firmware)
            self._firmware.forget()  # half a packet of the client before
            client.settimeout(0.05)
            client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            with client:
                self._serve_client(client)

    def _serve_client(self, client: socket.socket) -> None:
        firmware = self._firmware
        assert isinstance(firmware, EPuck2Firmware)
        due = 0.0
        calibrated = firmware.calibrated
        while not self._leave.is_set():
            if firmware.calibrated != calibrated:  # neither hears nor sends for some time
                calibrated = firmware.calibrated
                self._leave.wait(CALIBRATION_S if self.rate else 0.0)
            try:
                patience = 0.002 if firmware.streaming else 0.05
                ready, _, _ = select.select([client, self._listener], [], [], patience)
                if self._listener in ready and (self._deaf or self._mute):
                    return  # a new client: the old connection is dead
                data = client.recv(4096) if client in ready else None
            except OSError:
                return
            if data == b"":
                return
            reply = self._converse(data) if data else self._overdue()
            now = time.monotonic()
            if (
                reply == b""
                and firmware.streaming
                and now >= due
                and not (self._deaf or self._mute)
            ):
                due = now + STREAM_S
                with self._lock:
                    packet = firmware.packet()
                reply = self._spoil(packet)
            if reply is None:
                return
            try:
                client.sendall(reply[:1])
                if len(reply) > 1:  # header and payload come apart
                    self._leave.wait(HEADER_S if firmware.streaming else 0.0)
                    client.sendall(reply[1:])
            except OSError:
                return
