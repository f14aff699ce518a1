"""The client, against a service that answers by a list. The scenarios and a notebook have it talk to a real one."""

import json
import os
import socket
import threading

import forcerig
import pytest

WELCOME = {"rig": "test"}


class Service:
    """Answers each request by its method; says what it got."""

    def __init__(self, folder, name, answers):
        self.got = []
        self.answers = {"hello": [{"result": WELCOME}], **answers}
        self.listener = socket.socket(socket.AF_UNIX)
        self.listener.bind(os.path.join(folder, f"{name}.sock"))
        self.listener.listen()
        threading.Thread(target=self.serve, daemon=True).start()

    def serve(self):
        while True:
            try:
                connection, _ = self.listener.accept()
            except OSError:
                return
            for line in connection.makefile("r"):
                request = json.loads(line)
                self.got.append(request)
                for message in self.answers.get(request["method"], []):
                    if message is None:
                        connection.shutdown(socket.SHUT_RDWR)
                        break
                    if "method" not in message:
                        message = {"id": request["id"], **message}
                    connection.sendall((json.dumps({"jsonrpc": "2.0", **message}) + "\n").encode())


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("FORCECTL_RUNTIME_DIR", str(tmp_path))
    return tmp_path


def test_requests_answers_and_notifications(folder):
    telemetry = {"method": "telemetry", "params": {"t_s": 1.0}}
    event = {"method": "event", "params": {"kind": "stop"}}
    held = {"result": {"metrics": {"applied_n": [0.0, 2.5, 0.0]}}}
    refusal = {"error": {"code": 2, "message": "another client commands"}}
    service = Service(folder, "rig", {"set_force": [telemetry, event, held], "stop": [telemetry, {"result": {}}], "hold": [refusal]})
    with forcerig.connect(client="a test") as rig:
        assert rig.welcome == WELCOME
        assert service.got[0]["params"] == {"version": 1, "client": "a test", "pid": os.getpid()}
        rig.start("set_force", force_n=[0, 2.5, 0], duration_s=1)
        assert list(rig.telemetry()) == [{"t_s": 1.0}] and rig.result == held["result"]
        assert rig.set_force((0, 2.5, 0), 1) == held["result"]
        assert rig.stop() == {}
        with pytest.raises(forcerig.RigError, match="another client commands") as error:
            rig.hold([2, 2, 2, 2, 2, 2])
        assert error.value.code == 2
        with pytest.raises(ValueError, match="JSON"):
            rig.set_force([float("nan"), 0, 0], 1)


def test_a_service_that_ends_is_told(folder):
    Service(folder, "rig", {"status": [None]})
    rig = forcerig.connect()
    with pytest.raises(ConnectionError, match="the service has ended"):
        rig.status()


def test_which_rig(folder):
    with pytest.raises(ConnectionError, match=r"rig `rig` is not running \(no rig is\)"):
        forcerig.connect()
    Service(folder, "usb", {})
    # A service that was killed leaves its socket.
    dead = socket.socket(socket.AF_UNIX)
    dead.bind(str(folder / "rig.sock"))
    dead.close()
    forcerig.connect().close()
    forcerig.connect("usb").close()
    Service(folder, "ttyACM0", {})
    with pytest.raises(ConnectionError, match=r"`rig` is not running \(running: ttyACM0, usb\)"):
        forcerig.connect()
    with pytest.raises(ValueError, match="address and port"):
        forcerig.connect(tcp="localhost")
