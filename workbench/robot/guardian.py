"""The guardian: a small process between a program and the wire, that stops the robot when the
program is gone or says nothing any more.

    robot = open_robot("tcp:192.168.1.20:1000", guardian=True)

No e-puck firmware has a watchdog: a robot whose program is killed (SIGKILL), stopped (SIGSTOP) or
swapped out drives on. The guardian owns the serial port or the socket and hands bytes on, both
ways. When its program's end of the pipe closes, or nothing has come for the watchdog's time, it
stops the robot as the guard does (``robot.guard``): again and again, until the robot stands.

What it cannot help: a computer that loses power, a wire that is cut, and a SIGKILL of the guardian
itself (the program is told that the link is lost).

Contract: one guardian a connection; it ends with it. POSIX only: elsewhere asking for one is an
error.
"""

import importlib
import json
import select
import signal
import socket
import struct
import subprocess
import sys
import time
from typing import Any

from workbench.robot import guard
from workbench.robot.clock import CLOCK, Clock
from workbench.robot.faults import LinkLost, NotSupported, RobotError
from workbench.robot.wire.links import Link, TcpLink

START_S = 10.0  # for the process to begin, on a busy computer
GIVE_UP_S = 10.0  # for stopping a robot that does not answer, once the program is gone
_HEAD = struct.Struct("<BI")  # kind of message, its length
_BYTES, _PATIENCE = range(2)
_OPEN, _FAILED = b"\x01", b"\x00"  # the guardian's first byte; why it failed follows


class GuardedLink(Link):
    """A link through a guardian of its own.

    Args:
        entry: module:class of the robot's back-end; address, options: what it is made with.
        silence_s: seconds without a word after which the guardian stops the robot, None for never.
        timeout_s, clock: see Link.

    Raises:
        LinkLost: the guardian could not open the wire.
        NotSupported: this system has no guardians.
    """

    def __init__(
        self,
        entry: str,
        address: str,
        options: dict[str, Any],
        *,
        silence_s: float | None,
        timeout_s: float,
        clock: Clock = CLOCK,
    ) -> None:
        super().__init__(timeout_s, clock)
        if not hasattr(socket, "AF_UNIX") or sys.platform == "win32":
            raise NotSupported("a guardian needs a POSIX system; leave guardian=True out")
        own, theirs = socket.socketpair()
        task = {"entry": entry, "address": address, "options": options, "silence_s": silence_s}
        with theirs:
            self._child = subprocess.Popen(
                [sys.executable, "-m", __name__, str(theirs.fileno()), json.dumps(task)],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                start_new_session=True,  # a Ctrl-C in the terminal is for the program
            )
        self._wire = own
        own.settimeout(START_S)
        try:
            said = own.recv(1)  # what the robot sends without being asked may follow at once
            if said != _OPEN:
                said = own.recv(4096)
        except OSError:
            said = b""
        if said != _OPEN:
            self.close()
            raise LinkLost(said.decode("utf-8", "replace") or "the guardian did not begin")
        own.settimeout(timeout_s)

    def write(self, data: bytes) -> None:
        self._tell(_BYTES, data)

    def patience(self, seconds: float) -> None:
        self._tell(_PATIENCE, struct.pack("<d", seconds))

    def fileno(self) -> int:
        return self._wire.fileno()

    def _tell(self, kind: int, data: bytes) -> None:
        try:
            self._wire.sendall(_HEAD.pack(kind, len(data)) + data)
        except OSError as error:
            raise LinkLost(f"the guardian is gone: {error}") from error

    def _receive(self, timeout_s: float) -> bytes:
        return TcpLink.receive_from(self._wire, timeout_s)

    def close(self) -> None:
        self._wire.close()
        try:
            self._child.wait(GIVE_UP_S)
        except subprocess.TimeoutExpired:
            pass  # it goes on trying to stop the robot


class _Guardian:
    """The other end: owns the wire."""

    def __init__(self, program: socket.socket, robot: Any, silence_s: float | None) -> None:
        self._program = program
        self._robot = robot
        self._silence_s = silence_s
        self._heard = time.monotonic()
        self._patient_until = 0.0
        self._stopped = True  # nothing has been told yet
        self._buffer = b""

    def run(self) -> None:
        """Hand bytes on until the program is gone."""
        link = self._robot._link
        while True:
            ready, _, _ = select.select([self._program, link], [], [], 0.02)
            if link in ready:
                self._hand_back(link._receive(0.0))
            if self._program in ready and not self._hear(link):
                return
            self._watch()

    def _hand_back(self, data: bytes) -> None:
        """Hand on what the robot says; a program that does not read loses it, and must not keep the
        guardian from stopping its robot.
        """
        try:
            self._program.send(data, socket.MSG_DONTWAIT)
        except BlockingIOError:
            pass  # its buffer is full

    def _hear(self, link: Link) -> bool:
        """Take what the program says; return whether it is still there."""
        try:
            data = self._program.recv(65536)
        except OSError:
            return False
        self._buffer += data
        self._heard = time.monotonic()
        while len(self._buffer) >= _HEAD.size:
            kind, length = _HEAD.unpack_from(self._buffer)
            if len(self._buffer) < _HEAD.size + length:
                break
            body = self._buffer[_HEAD.size : _HEAD.size + length]
            self._buffer = self._buffer[_HEAD.size + length :]
            if kind == _BYTES:
                self._stopped = False
                link.write(body)
            else:
                self._patient_until = self._heard + struct.unpack("<d", body)[0]
        return bool(data)

    def _watch(self) -> None:
        """Stop the robot when the program has said nothing for too long."""
        now = time.monotonic()
        quiet = self._silence_s is not None and now - self._heard > self._silence_s
        if quiet and now > self._patient_until and not self._stopped:
            self._stopped = True
            guard.stop(self._robot, CLOCK)

    def end(self) -> None:
        """Stop the robot, for as long as there is a wire."""
        until = time.monotonic() + GIVE_UP_S
        while time.monotonic() < until:
            try:
                guard.stop(self._robot, CLOCK)
                return
            except LinkLost:
                return
            except RobotError:
                pass  # again


def main() -> None:
    """Run as the guardian of the program at the other end of an inherited socket."""
    program = socket.socket(fileno=int(sys.argv[1]))
    task = json.loads(sys.argv[2])
    for name in ("SIGINT", "SIGHUP"):
        signal.signal(getattr(signal, name), signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda number, frame: sys.exit(0))
    module, name = task["entry"].split(":")
    robot = getattr(importlib.import_module(module), name)(task["address"], **task["options"])
    try:
        robot._open()
    except RobotError as error:
        program.sendall(_FAILED + str(error).encode())
        return
    program.sendall(_OPEN)
    guardian = _Guardian(program, robot, task["silence_s"])
    try:
        guardian.run()
    except (RobotError, OSError):
        pass  # the wire or the program is gone
    finally:
        guardian.end()
        robot._close()


if __name__ == "__main__":
    main()
