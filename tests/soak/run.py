#!/usr/bin/env python3
"""A daemon under a stream of edits, poses, snapshots and clients that come and die: what it holds must stay flat.

    cargo build --release
    tests/soak/run.py [--minutes 10] [--edits-hz 10] [--validation] …      (--help tells the rest)

Nodes come, move, change shape, role and material, and go; lights and environments change; one list of edits in eight is wrong on purpose, and
must change nothing; one in four is to be durable. A tracker moves the eye sixty times a second. Clients ask for snapshots; others connect and
hang up in the middle of a line, or of an answer. Each minute prints what the process and the device hold: resident memory, what
`status` says of the scene's and the projectors' bytes, open files, threads.

The scene goes around in cycles, and each sample is taken at a cycle's end, when it is the same small one again: what grows from one sample
to the next was not given back. It ends with 1 where, after a warm-up of a fifth of the time, resident memory grew by more than 2 %, a
descriptor or a thread stayed, the device's bytes did not come back, the log tells of a panic or of a validation message, or the daemon
does not end by itself. Works on Linux alone (/proc).
"""

import argparse
import contextlib
import json
import os
import pathlib
import random
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time

REPOSITORY = pathlib.Path(__file__).resolve().parent.parent.parent

CONFIG = """
[daemon]
state_dir = "state"

[render]
samples = 1
max_depth = 4

[scene]
environment = "lantern:studio"
[[scene.node]]
name = "floor"
uri = "lantern:checker"
scale = [0.4, 0.4, 0.4]
[[scene.light]]
name = "lamp"
kind = "point"
position_m = [0.5, 2, 1]
intensity = 12

[[body]]
name = "head"
drives = "viewer"
position_m = [0, 1.6, 2.2]

[[tracker]]
name = "tracker"
protocol = "lantern"
listen = "127.0.0.1:0"
bodies = { "1" = "head" }
"""

PROJECTOR = """
[[projector]]
name = "%s"
resolution_px = [96, 60]
output = { kind = "headless", refresh_hz = 60 }
[projector.calibration]
convention = "opengl"
projection = [[1.5, 0, 0, 0], [0, 2.4, 0, 0], [0, 0, -1.02, -0.2], [0, 0, -1, 0]]
view = [[1, 0, 0, %g], [0, 0.8, -0.6, 0.3], [0, 0.6, 0.8, -3], [0, 0, 0, 1]]
"""

SHAPES = {"lantern:sphere": "sphere", "lantern:teapot": "paint", "lantern:cube": "cube", "lantern:checker": "red"}
NODES = 12
SNAPSHOTS = ["color", "radiance", "distance", "depth", "node", "weight", "room"]


class Refused(Exception):
    """The daemon's no."""


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
        reply = json.loads(self.stream.readline())
        if "error" in reply:
            raise Refused(reply["error"])
        answer = reply["ok"]
        if op == "snapshot":
            self.stream.read(answer["bytes"])
        return answer

    def close(self):
        self.stream.close()
        self.socket.close()


class Edits:
    """An endless cycle of lists of edits that ends where it began."""

    def __init__(self, seed):
        self.random = random.Random(seed)
        self.there = []
        self.step = 0
        self.last_revision = 0

    def at_end_of_cycle(self):
        return not self.there and self.step > 0

    def colour(self):
        return [round(self.random.random(), 3) for _ in range(3)]

    def place(self):
        return [round(self.random.uniform(-0.8, 0.8), 3), 0.2, round(self.random.uniform(-0.8, 0.8), 3)]

    def next(self):
        self.step += 1
        phase = self.step % (6 * NODES)
        if phase < NODES:
            name, shape = f"n{self.step}", self.random.choice(list(SHAPES))
            self.there.append((name, shape))
            role = self.random.choice(["prop", "prop", "virtual", "raster", "mask"])
            return [{"add": {"node": name, "uri": shape, "role": role, "translation_m": self.place(), "scale": [0.12] * 3}}]
        if phase >= 5 * NODES:
            if not self.there:
                return [{"light": {"name": "lamp", "intensity": 12}}]
            name, _ = self.there.pop(self.random.randrange(len(self.there)))
            return [{"remove": {"node": name}}]
        name, shape = self.random.choice(self.there)
        kind = self.random.randrange(7)
        if kind == 0:
            material = f"{name}/{SHAPES[shape]}"
            return [{"material": {"name": material, "base_color": self.colour(), "metallic": round(self.random.random(), 2), "roughness": 0.1}}]
        if kind == 1:
            return [{"light": {"name": "lamp", "intensity": round(self.random.uniform(5, 20), 2), "color": self.colour()}}]
        if kind == 2:
            return [{"environment": {"color": self.colour()} if self.random.random() < 0.7 else {"uri": "lantern:studio"}}]
        if kind == 3 and shape == "lantern:cube":
            bent = [[round(x * self.random.uniform(0.8, 1.2), 4) for x in corner] for corner in cube()]
            return [{"vertices": {"node": name, "mesh": 0, "positions_m": bent}}]
        if kind == 4:
            return [{"set": {"node": name, "role": self.random.choice(["prop", "virtual", "raster", "mask"]), "visible": self.random.random() < 0.8}}]
        return [{"set": {"node": name, "translation_m": self.place()}}]


def cube():
    """The vertices of `lantern:cube`: four a face, faces of the axes' six ends."""
    x, y, z = (1, 0, 0), (0, 1, 0), (0, 0, 1)

    def back(v):
        return tuple(-c for c in v)

    corners = []
    for right, up in [(x, y), (back(x), y), (z, y), (back(z), y), (x, back(z)), (x, z)]:
        out = tuple(right[(i + 1) % 3] * up[(i + 2) % 3] - right[(i + 2) % 3] * up[(i + 1) % 3] for i in range(3))
        for a, b in [(-1, -1), (1, -1), (1, 1), (-1, 1)]:
            corners.append([(o + a * r + b * u) / 2 for o, r, u in zip(out, right, up)])
    return corners


def resident_kib(pid):
    return int(re.search(r"VmRSS:\s+(\d+) kB", pathlib.Path(f"/proc/{pid}/status").read_text())[1])


def descriptors(pid):
    return len(os.listdir(f"/proc/{pid}/fd"))


def threads(pid):
    return len(os.listdir(f"/proc/{pid}/task"))


def head(stop, address, rate_hz):
    """A tracker: the eye goes around."""
    sender = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sequence, chance = 0, random.Random(7)
    while not stop.wait(1 / rate_hz):
        sequence += 1
        eye = [chance.uniform(-1, 1), chance.uniform(1.4, 1.8), chance.uniform(1.8, 2.6)]
        sender.sendto(struct.pack("<4sBBHIIQ3f4f3f", b"LNTP", 1, 3, 1, sequence, 0, time.monotonic_ns(), *eye, 0, 0, 0, 1, 0, 0, 0), address)
        if sequence % 50 == 0:
            sender.sendto(chance.randbytes(chance.randrange(100)), address)


def asks(stop, path, counts):
    """Snapshots, and clients that die."""
    chance = random.Random(8)
    while not stop.wait(0.5):
        with contextlib.suppress(OSError, ValueError):
            client = Client(path)
            fate = chance.randrange(4)
            if fate < 2:
                client.ask("snapshot", projector=chance.choice(["left", "right"]), layer=chance.choice(SNAPSHOTS))
                counts["snapshots"] += 1
            elif fate == 2:
                client.socket.sendall(b'{"id": 1, "op": "scene.apply", "edits": [{"add"')
                counts["hung up"] += 1
            else:
                client.socket.sendall(b'{"id": 1, "op": "snapshot", "projector": "left", "layer": "radiance"}\n')
                counts["hung up"] += 1
            client.close()


def sample(client, pid):
    status = client.ask("status")
    return {
        "resident_kib": resident_kib(pid),
        "scene_bytes": status["scene"]["bytes"],
        "projector_bytes": sum(p["gpu_bytes"] for p in status["projectors"].values()),
        "descriptors": descriptors(pid),
        "threads": threads(pid),
        "revision": status["scene"]["revision"],
        "frames": sum(p["frames"] for p in status["projectors"].values()),
    }


def connect(path, daemon):
    for _ in range(1200):
        if daemon.poll() is not None:
            raise SystemExit(f"lanternd ended with {daemon.returncode}")
        with contextlib.suppress(OSError):
            return Client(path)
        time.sleep(0.1)
    raise SystemExit("lanternd does not answer")


def soak(options, folder):
    config, path, log = folder / "soak.toml", folder / "lanternd.sock", folder / "log"
    config.write_text(CONFIG + PROJECTOR % ("left", 0.3) + PROJECTOR % ("right", -0.3))
    surroundings = {**os.environ, "CACHE_DIRECTORY": str(folder / "cache"), "NO_COLOR": "1"}
    if options.validation:
        surroundings["LANTERN_VALIDATION"] = "1"
    with log.open("wb") as into:
        daemon = subprocess.Popen(
            [str(options.lanternd), "run", "-c", str(config), "--socket", str(path)], stderr=into, stdout=into, env=surroundings
        )
    try:
        client = connect(path, daemon)
        host, _, port = client.ask("status")["trackers"]["tracker"]["listen"].rpartition(":")
        stop, counts = threading.Event(), {"edits": 0, "refused": 0, "snapshots": 0, "hung up": 0}
        others = [
            threading.Thread(target=head, args=(stop, (host, int(port)), 60)),
            threading.Thread(target=asks, args=(stop, path, counts)),
        ]
        for other in others:
            other.start()
        faults = []
        try:
            samples = stream(options, client, daemon.pid, counts, faults)
        finally:
            stop.set()
            for other in others:
                other.join()
        client.close()
    finally:
        daemon.send_signal(signal.SIGTERM)
        try:
            ended = daemon.wait(30)
        except subprocess.TimeoutExpired:
            daemon.kill()
            ended = "no end"
    if ended != 0:
        faults.append(f"lanternd ended with {ended}")
    ills = [line for line in log.read_text(errors="replace").splitlines() if "panicked" in line or "vulkan::validation" in line]
    faults += [f"log: {line}" for line in ills[:5]]
    return samples, counts, faults


def stream(options, client, pid, counts, faults):
    """Edits until the time is over; a sample at the first end of a cycle in each minute."""
    edits, chance = Edits(options.seed), random.Random(options.seed + 1)
    start, samples, every_s = time.monotonic(), [], 60 * min(1, options.minutes / 10)
    print(f"{'min':>6} {'resident KiB':>13} {'scene bytes':>12} {'projectors':>12} {'files':>6} {'threads':>8} {'frames':>8} {'edits':>7}")
    while time.monotonic() - start < 60 * options.minutes or not edits.at_end_of_cycle():
        turn = time.monotonic()
        listed = edits.next()
        before = client.ask("status")["scene"]["revision"]
        if chance.randrange(8) == 0:
            try:
                client.ask("scene.apply", edits=listed + [{"remove": {"node": "nobody"}}], durable=False)
                faults.append(f"a wrong list was taken: {listed}")
            except Refused:
                counts["refused"] += 1
            if client.ask("status")["scene"]["revision"] != before:
                faults.append(f"a refused list changed the scene: {listed}")
        client.ask("scene.apply", edits=listed, durable=chance.randrange(4) == 0)
        counts["edits"] += 1
        if edits.at_end_of_cycle() and turn - start >= every_s * len(samples):
            # What is on its way, or was put back, settles.
            time.sleep(0.5)
            samples.append(sample(client, pid))
            s = samples[-1]
            print(
                f"{(turn - start) / 60:6.1f} {s['resident_kib']:13} {s['scene_bytes']:12} {s['projector_bytes']:12} {s['descriptors']:6}"
                f" {s['threads']:8} {s['frames']:8} {counts['edits']:7}",
                flush=True,
            )
        time.sleep(max(0, turn + 1 / options.edits_hz - time.monotonic()))
    return samples


def judge(samples, faults):
    """What grew between the end of the warm-up and the end."""
    if len(samples) < 4:
        faults.append(f"{len(samples)} samples are too few")
        return
    warm = samples[max(1, len(samples) // 5) :]
    # A sample may catch a client in the air, or a buffer one size larger: the fewest of each half are compared.
    half = len(warm) // 2
    early, late = warm[:half], warm[half:]
    fewest = {key: (min(s[key] for s in early), min(s[key] for s in late)) for key in early[0]}
    grown = fewest["resident_kib"][1] / fewest["resident_kib"][0] - 1
    print(f"resident memory: {grown:+.2%} from the first half after the warm-up to the second")
    if grown > 0.02:
        faults.append(f"resident memory grew by {grown:.1%}")
    for key in ("scene_bytes", "projector_bytes", "descriptors", "threads"):
        before, after = fewest[key]
        if after > before:
            faults.append(f"{key} grew from {before} to {after}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanternd", type=pathlib.Path, default=REPOSITORY / "target/release/lanternd")
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--edits-hz", type=float, default=10, help="lists of edits a second at most")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--validation", action="store_true", help="with the validation layers, whose memory grows by itself")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        samples, counts, faults = soak(options, pathlib.Path(folder))
    print(", ".join(f"{count} {what}" for what, count in counts.items()))
    judge(samples, faults)
    for fault in faults:
        print(f"FAULT: {fault}")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
