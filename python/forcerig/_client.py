"""Client of a force rig's service: JSON-RPC 2.0, one object per line, over its Unix socket (docs/service.md).

This module needs no packages.
"""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

VERSION = 1
"""Version of the protocol."""


class RigError(Exception):
    """The service refused a request; `code` is its number (docs/service.md)."""

    def __init__(self, error: dict[str, Any]) -> None:
        super().__init__(error["message"])
        self.code: int = error["code"]


def connect(name: str | None = None, *, client: str = "python", tcp: str | None = None, token: str | None = None) -> Client:
    """Connects to the service of a rig that runs.

    Args:
        name: The rig: `rig` for an emulated one (`forcectl rig`), `usb`, or the port's name as `ttyACM0`. None: the emulated
            one, else the only one that there is.
        client: What this program is called in messages to others.
        tcp: Address and port of a service with `--tcp` instead, as `127.0.0.1:4747`.
        token: Its token.

    Raises:
        ConnectionError: No such rig is running, or several are.
    """
    if tcp is not None:
        host, _, port = tcp.rpartition(":")
        if not port.isdigit():
            raise ValueError(f"tcp is {tcp!r}: give address and port, as 127.0.0.1:4747")
        connection = socket.create_connection((host.strip("[]"), int(port)))
        # A stop is a short line that must not wait for others.
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return Client(connection, client, token)
    if not hasattr(socket, "AF_UNIX"):
        raise ConnectionError("this system has no Unix sockets: give tcp, with the address of a service with `--tcp`")
    running = _running()
    if name is None:
        name = "rig" if "rig" in running or len(running) != 1 else next(iter(running))
    if name not in running:
        there = f"running: {', '.join(running)}" if running else "no rig is"
        raise ConnectionError(
            f"rig `{name}` is not running ({there}); `forcectl rig` starts an emulated one, `forcectl serve --link usb` serves a board"
        )
    return Client(_open(running[name]), client, None)


def _folders() -> list[Path]:
    """Folders in which a service of this account may listen, in the order of forcectl."""
    if folder := os.environ.get("FORCECTL_RUNTIME_DIR"):
        return [Path(folder)]
    import pwd  # There is none on Windows.

    account = os.getuid()
    try:
        home = [pwd.getpwuid(account).pw_dir]
    except KeyError:
        home = []
    runtime = [folder for folder in [os.environ.get("XDG_RUNTIME_DIR")] if folder]
    own = [folder for folder in [os.environ.get("HOME")] if folder]
    below_runtime = [Path(folder) / "forcectl" for folder in runtime]
    below_own = [Path(folder) / ".local/state/forcectl/run" for folder in own]
    usual = [Path(f"/run/user/{account}/forcectl"), *(Path(folder) / ".local/state/forcectl/run" for folder in home)]
    return list(dict.fromkeys(below_runtime + below_own + usual))


def _running() -> dict[str, Path]:
    """Sockets of the services that answer, by the rigs' names."""
    found: dict[str, Path] = {}
    folders = _folders()
    for folder in folders:
        try:
            sockets = sorted(folder.glob("*.sock"))
            # A client sends forces to whoever answers: not in a folder of another account, unless the variables name it.
            if folder != folders[0] and folder.stat().st_uid != os.getuid():
                continue
        except OSError:
            continue
        for path in sockets:
            try:
                _open(path).close()
            except OSError:
                continue
            found.setdefault(path.stem, path)
    return found


def _open(path: Path) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX)
    try:
        connection.connect(os.fspath(path))
    except OSError:
        connection.close()
        raise
    return connection


class Client:
    """A connection to the service of one rig. Any number may be open; one of them commands. `connect` makes one.

    It is a context manager; when it is closed while it commands, the service disarms the rig.
    """

    def __init__(self, connection: socket.socket, client: str, token: str | None = None) -> None:
        self._socket = connection
        self._lines = connection.makefile("r", encoding="utf-8")
        self._id = 0
        self._started: int | None = None
        self._ended: dict[str, Any] | None = None
        self.result: dict[str, Any] | None = None
        """Answer to the request of `start`, once it has come."""
        hello: dict[str, Any] = {"version": VERSION, "client": client, "pid": os.getpid()}
        if token is not None:
            hello["token"] = token
        try:
            self.welcome: dict[str, Any] = self.call("hello", **hello)
            """`name` of the rig, `link`, `board`, `rig_file`, `seed` of an emulated rig."""
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Client:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the connection. A rig that this client commands is disarmed."""
        self._lines.close()
        self._socket.close()

    def _send(self, method: str, params: dict[str, Any]) -> int:
        self._id += 1
        request = {"jsonrpc": "2.0", "id": self._id, "method": method, "params": params}
        self._socket.sendall((json.dumps(request, allow_nan=False) + "\n").encode())
        return self._id

    def _read(self) -> dict[str, Any]:
        line = self._lines.readline()
        if not line:
            raise ConnectionError("the service has ended; a board without setpoints goes to 0 V")
        return json.loads(line)

    def call(self, method: str, **params: Any) -> Any:
        """Sends a request and waits for its answer. Notifications that come meanwhile are dropped.

        Raises:
            RigError: The service refused it.
        """
        number = self._send(method, params)
        while True:
            message = self._read()
            if message.get("id") == number:
                if "error" in message:
                    raise RigError(message["error"])
                return message["result"]
            if self._started is not None and message.get("id") == self._started:
                self._ended = message

    def subscribe(self, **topics: bool) -> Any:
        """Topics from now on: telemetry=True (50/s), events=True, ticks=True (500/s), truth=True (emulated rig)."""
        return self.call("subscribe", **topics)

    def start(self, method: str, **params: Any) -> None:
        """Sends a request whose answer comes at the end (`set_force`, `hold`); see `notifications` and `telemetry`."""
        self.result = None
        self._ended = None
        self._started = self._send(method, params)

    def notifications(self) -> Iterator[tuple[str, dict[str, Any]]]:
        """Notifications as (topic, content) until the request of `start` is answered; its answer is `result`.

        Raises:
            RigError: The service refused it, or the run failed.
        """
        while True:
            message = self._ended or self._read()
            if "method" in message:
                yield message["method"], message["params"]
            elif message.get("id") == self._started:
                if "error" in message:
                    raise RigError(message["error"])
                self.result = message["result"]
                return

    def telemetry(self) -> Iterator[dict[str, Any]]:
        """The telemetry among the notifications; keys with units: docs/service.md."""
        return (content for topic, content in self.notifications() if topic == "telemetry")

    def set_force(self, force_n: Sequence[float], duration_s: float) -> dict[str, Any]:
        """Holds a force at the tip for some time and waits for the end.

        Args:
            force_n: x, y, z, N, robot base frame.
            duration_s: Time to hold it, s.

        Returns:
            The object of `forcectl set-force --json`: figures are in `metrics`.
        """
        return self.call("set_force", force_n=[float(part) for part in force_n], duration_s=float(duration_s))

    def hold(self, tension_n: Sequence[float] | None = None) -> Any:
        """Holds tensions until `disarm`: six, N, or those of zero force at the tip. Returns when it holds."""
        return self.call("hold", **({} if tension_n is None else {"tension_n": [float(n) for n in tension_n]}))

    def status(self) -> dict[str, Any]:
        """Status of the board, who commands, who is connected."""
        return self.call("status")

    def stop(self) -> Any:
        """All motors to 0 V at once, latched. Works whoever commands; returns when the board has confirmed."""
        return self.call("stop")

    def disarm(self) -> Any:
        """Ramps the tensions down. Returns when the motors are at 0 V."""
        return self.call("disarm")

    def clear(self) -> Any:
        """Clears latched faults; `fault` of the answer is what remains."""
        return self.call("clear")

    def command(self) -> Any:
        """Takes the commander's role. `set_force` and `hold` do it by themselves."""
        return self.call("command")

    def release(self) -> Any:
        """Gives the commander's role back."""
        return self.call("release")

    def inject(self, what: str) -> Any:
        """Causes a fault in an emulated rig, as `unplug=3`; `forcectl inject help` lists them."""
        return self.call("inject", what=what)

    def shutdown(self) -> Any:
        """Ends the service, and with it an emulated rig."""
        return self.call("shutdown")
