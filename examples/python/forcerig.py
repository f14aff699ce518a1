"""Client of a force rig's service: JSON-RPC 2.0, one object per line, over its Unix socket (docs/service.md).

Needs Python 3.9 and no packages.

    rig = Rig()                              # the rig that `forcectl rig` keeps
    rig.subscribe(telemetry=True)
    rig.start("set_force", force_n=[0, 2.5, 0], duration_s=5)
    for line in rig.telemetry():             # until the force has been held
        print(line["t_s"], line["tension_n"])
    print(rig.result["metrics"]["applied_n"])
"""

import json
import os
import socket

VERSION = 1


class RigError(Exception):
    """The service refused a request; `code` is its number (docs/service.md)."""

    def __init__(self, error):
        super().__init__(error["message"])
        self.code = error["code"]


def socket_path(name="rig"):
    """Path of a rig's socket, as forcectl finds it."""
    folder = os.environ.get("FORCECTL_RUNTIME_DIR")
    if not folder:
        runtime = os.environ.get("XDG_RUNTIME_DIR")
        home = os.path.expanduser("~/.local/state/forcectl/run")
        folder = os.path.join(runtime, "forcectl") if runtime else home
    return os.path.join(folder, f"{name}.sock")


class Rig:
    """A connection to the service of one rig. Any number may be open; one of them commands."""

    def __init__(self, name="rig", client="python"):
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.connect(socket_path(name))
        self._lines = self._socket.makefile("r", encoding="utf-8")
        self._id = 0
        self._started = None
        self._ended = None
        self.result = None
        self.welcome = self.call("hello", version=VERSION, client=client, pid=os.getpid())

    def _send(self, method, params):
        self._id += 1
        request = {"jsonrpc": "2.0", "id": self._id, "method": method, "params": params}
        self._socket.sendall((json.dumps(request) + "\n").encode())
        return self._id

    def _read(self):
        line = self._lines.readline()
        if not line:
            raise ConnectionError("the service has ended; a board without setpoints goes to 0 V")
        return json.loads(line)

    def call(self, method, **params):
        """Sends a request and waits for its answer. Notifications that come meanwhile are dropped."""
        number = self._send(method, params)
        while True:
            message = self._read()
            if message.get("id") == number:
                if "error" in message:
                    raise RigError(message["error"])
                return message["result"]
            if self._started is not None and message.get("id") == self._started:
                self._ended = message

    def subscribe(self, **topics):
        """Topics: telemetry=True, events=True, ticks=True, truth=True."""
        return self.call("subscribe", **topics)

    def start(self, method, **params):
        """Sends a request whose answer comes at the end (`set_force`); see `notifications`."""
        self.result = None
        self._ended = None
        self._started = self._send(method, params)

    def notifications(self):
        """Notifications as (topic, content) until the request of `start` is answered; its answer is `result`."""
        while True:
            message = self._ended or self._read()
            if "method" in message:
                yield message["method"], message["params"]
            elif message.get("id") == self._started:
                if "error" in message:
                    raise RigError(message["error"])
                self.result = message["result"]
                return

    def telemetry(self):
        """The telemetry among the notifications."""
        return (content for topic, content in self.notifications() if topic == "telemetry")

    def stop(self):
        """All motors to 0 V at once. Works whoever commands."""
        return self.call("stop")
