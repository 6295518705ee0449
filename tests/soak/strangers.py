"""What a daemon has to bear beside the edits of a soak: a tracker, and clients of every sort."""

import contextlib
import json
import os
import pathlib
import random
import signal
import socket
import struct
import sys
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "clients"))

from lantern import Client, Gone, Refused  # noqa: E402  (it lies in the folder that was just named)

LAYERS = ["color", "radiance", "distance", "depth", "node", "weight", "room"]
EVENTS = ["frame", "pose", "scene", "tracker"]


class Strangers:
    """They are there until the block ends. What they did is counted; what they were not answered right is a fault."""

    def __init__(self, daemon, tracker, config, counts, faults):
        self.daemon, self.tracker, self.config, self.counts, self.faults = daemon, tracker, config, counts, faults
        self.good = config.read_text()
        self.over, self.chance = threading.Event(), random.Random(8)
        deeds = [self.snapshot, self.hang_up_in_a_line, self.hang_up_in_an_answer, self.say_too_much, self.talk_nonsense]
        deeds += [self.subscribe, self.subscribe_and_not_read, self.pose, self.reload, self.reload_badly, self.many_at_once]
        self.counts |= {deed.__name__.replace("_", " "): 0 for deed in deeds}
        self.deeds = deeds
        self.threads = [threading.Thread(target=self.track), threading.Thread(target=self.act)]

    def __enter__(self):
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        for thread in self.threads:
            thread.join()

    def track(self):
        """A tracker: the eye goes around, and now and then a datagram is none."""
        sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sequence, chance = 0, random.Random(7)
        while not self.over.wait(1 / 60):
            sequence += 1
            eye = [chance.uniform(-1, 1), chance.uniform(1.4, 1.8), chance.uniform(1.8, 2.6)]
            sender.sendto(struct.pack("<4sBBHIIQ3f4f3f", b"LNTP", 1, 3, 1, sequence, 0, time.monotonic_ns(), *eye, 0, 0, 0, 1, 0, 0, 0), self.tracker)
            if sequence % 50 == 0:
                sender.sendto(chance.randbytes(chance.randrange(100)), self.tracker)

    def act(self):
        """One deed after the other, in an order of chance in which none is left out."""
        waiting = []
        while not self.over.wait(0.4):
            if not waiting:
                waiting = self.chance.sample(self.deeds, len(self.deeds))
            deed = waiting.pop()
            try:
                deed()
                self.counts[deed.__name__.replace("_", " ")] += 1
            except (OSError, Gone, Refused, AssertionError) as error:
                self.faults.append(f"{deed.__name__}: {error!r}")

    def client(self):
        return Client(self.daemon.path)

    def snapshot(self):
        # All layers each time: the first of one may have shaders compiled, which is for the warm-up.
        client, projector = self.client(), self.chance.choice(["left", "right"])
        for layer in LAYERS:
            client.ask("snapshot", projector=projector, layer=layer)
        client.close()

    def hang_up_in_a_line(self):
        client = self.client()
        client.socket.sendall(b'{"id": 1, "op": "scene.apply", "edits": [{"add"')
        client.close()

    def hang_up_in_an_answer(self):
        client = self.client()
        client.socket.sendall(b'{"id": 1, "op": "snapshot", "projector": "left", "layer": "radiance"}\n')
        client.close()

    def say_too_much(self):
        client = self.client()
        try:
            client.socket.sendall(b"[" * (3 << 20))
        except OSError:
            # The daemon may have hung up already; its word is there all the same.
            pass
        reply = json.loads(client.stream.readline())
        assert reply["id"] is None and reply["error"]["code"] == "line-too-long", reply
        assert client.stream.readline() == b"", "it goes on after a line that is too long"
        client.close()

    def talk_nonsense(self):
        client = self.client()
        for line in [b"{", b"\xff\xfe", b"[1, 2]", b'{"id": 1}', b'{"id": 1, "op": "dance"}', self.chance.randbytes(200).replace(b"\n", b"")]:
            client.socket.sendall(line + b"\n")
            assert "error" in json.loads(client.stream.readline()), line
        client.ask("hello")
        client.close()

    def subscribe(self):
        client = self.client()
        client.ask("subscribe", events=EVENTS)
        for _ in range(5):
            assert "event" in json.loads(client.stream.readline())
        client.close()

    def subscribe_and_not_read(self):
        client = self.client()
        client.ask("subscribe", events=EVENTS)
        self.over.wait(1)
        client.close()

    def pose(self):
        client = self.client()
        client.ask("pose", body="head", position_m=[self.chance.uniform(-1, 1), 1.6, 2.2])
        client.close()

    def reload(self):
        client = self.client()
        client.ask("config.reload")
        client.close()

    def reload_badly(self):
        self.config.write_text(self.good.replace("samples = 1", "samples = 3"))
        client = self.client()
        try:
            client.ask("config.reload")
            raise AssertionError("a wrong configuration was taken")
        except Refused:
            pass
        finally:
            self.config.write_text(self.good)
        os.kill(self.daemon.process.pid, signal.SIGHUP)
        client.close()

    def many_at_once(self):
        """More than there may be, all asking at the same time, which takes as many of the daemon's threads; those who are too many are told so."""
        clients, answers = [self.client() for _ in range(24)], []
        for client in clients:
            # Who is too many may have been hung up on already.
            with contextlib.suppress(BrokenPipeError):
                client.socket.sendall(b'{"id": 1, "op": "snapshot", "projector": "left", "layer": "color"}\n')
        for client in clients:
            answers.append(json.loads(client.stream.readline()))
            client.close()
        refused = [answer for answer in answers if "error" in answer]
        assert 0 < len(refused) < len(answers), f"{len(refused)} of {len(answers)} were refused"
        assert all(answer["error"]["code"] in ("too-many-clients", "busy") for answer in refused), refused
        # Their places are free again when the daemon has seen them go.
        self.over.wait(0.5)
