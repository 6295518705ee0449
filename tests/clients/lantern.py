"""A daemon of one's own, and connections to its control socket, for the scripts beside this folder (see docs/protocol.md)."""

import contextlib
import json
import os
import pathlib
import signal
import socket
import subprocess
import time

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent

# What no line of a healthy daemon's log has in it.
ILLS = ["panicked", "vulkan::validation"]


class Refused(Exception):
    """The daemon's no."""


class Gone(Exception):
    """The daemon has ended the connection, or itself."""


class Client:
    """One connection to the control socket."""

    def __init__(self, path):
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.settimeout(120)
        self.socket.connect(str(path))
        self.stream = self.socket.makefile("rb")
        self.number = 0

    def ask(self, op, **parameters):
        self.number += 1
        line = json.dumps({"id": self.number, "op": op, **parameters})
        self.socket.sendall(line.encode() + b"\n")
        line = self.stream.readline()
        if not line.endswith(b"\n"):
            raise Gone
        reply = json.loads(line)
        if "error" in reply:
            raise Refused(reply["error"])
        answer = reply["ok"]
        if op == "snapshot":
            self.stream.read(answer["bytes"])
        return answer

    def close(self):
        self.stream.close()
        self.socket.close()


class Daemon:
    """A process of `lanternd run`, with a cache of its own. Where it ends by itself, whoever waits for it is told."""

    def __init__(self, program, config, path, log, validation=False, before=()):
        # As lanternd.service has it.
        surroundings = {"MALLOC_ARENA_MAX": "2", **os.environ, "CACHE_DIRECTORY": str(log.parent / "cache"), "NO_COLOR": "1"}
        if validation:
            surroundings["LANTERN_VALIDATION"] = "1"
        self.path, self.log = path, log
        self.started = time.monotonic()
        with log.open("wb") as into:
            self.process = subprocess.Popen(
                [*before, str(program), "run", "-c", str(config), "--socket", str(path)], stderr=into, stdout=into, env=surroundings
            )

    def connect(self, limit_s=120):
        """A connection; the first is there when the first picture stands."""
        while time.monotonic() - self.started < limit_s:
            if self.process.poll() is not None:
                raise SystemExit(f"lanternd ended with {self.process.returncode}:\n{self.log.read_text(errors='replace')}")
            with contextlib.suppress(OSError):
                return Client(self.path)
            time.sleep(0.002)
        raise SystemExit("lanternd does not answer")

    def kill(self):
        self.process.kill()
        self.process.wait()

    def stop(self, limit_s=30):
        """Asks it to end, and tells how it did: 0 is well."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        try:
            return self.process.wait(limit_s)
        except subprocess.TimeoutExpired:
            self.kill()
            return "no end"

    def ills(self):
        lines = self.log.read_text(errors="replace").splitlines()
        return [line for line in lines if any(ill in line for ill in ILLS)]
