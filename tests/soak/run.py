#!/usr/bin/env python3
"""A daemon under a stream of edits, poses, snapshots and clients that come and die: what it holds must stay flat.

    cargo build --release
    tests/soak/run.py [--minutes 10] [--edits-hz 10] [--validation] …      (--help tells the rest)

Nodes come, move, change shape, role and material, and go; lights and environments change; one list of edits in eight is wrong on purpose, and
must change nothing; one in four is to be durable. Strangers (strangers.py) do what strangers do: a tracker moves the eye sixty times a second and
talks nonsense now and then, the socket says poses too, clients ask for snapshots, subscribe and read or do not, hang up in the middle of a line
or of an answer, send lines that are too long or no JSON, have the configuration read again, good and bad. Each minute prints what the process and the
device hold: resident memory, what `status` says of the scene's and the projectors' bytes, open files, threads.

The scene goes around in cycles, and each sample is taken at a cycle's end, when it is the same small one again: what grows from one sample
to the next was not given back. It ends with 1 where, after a warm-up of a fifth of the time (and no less than 18 s), resident memory grew by more than 2 %, a
descriptor or a thread stayed, the device's bytes did not come back, the log tells of a panic or of a validation message, or the daemon
does not end by itself. Works on Linux alone (/proc).
"""

import argparse
import os
import pathlib
import random
import re
import sys
import tempfile
import time

from strangers import Strangers  # It puts its own folder's neighbour on the path.

from lantern import REPOSITORY, Daemon, Refused

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

# A fifth of the time, and no less than this: pools of threads and of memory fill, and the first of each kind of edit has its shaders compiled.
WARM_UP_S = 18


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


def soak(options, folder):
    good = CONFIG + PROJECTOR % ("left", 0.3) + PROJECTOR % ("right", -0.3)
    config = folder / "soak.toml"
    config.write_text(good)
    daemon = Daemon(options.lanternd, config, folder / "lanternd.sock", folder / "log", options.validation)
    faults = []
    try:
        client = daemon.connect()
        host, _, port = client.ask("status")["trackers"]["tracker"]["listen"].rpartition(":")
        counts = {"edits": 0, "refused": 0}
        with Strangers(daemon, (host, int(port)), config, counts, faults):
            samples = stream(options, client, daemon.process.pid, counts, faults)
        client.close()
    finally:
        ended = daemon.stop()
    if ended != 0:
        faults.append(f"lanternd ended with {ended}")
    faults += [f"log: {line}" for line in daemon.ills()[:5]]
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
            samples.append({**sample(client, pid), "at_s": turn - start})
            s = samples[-1]
            print(
                f"{(turn - start) / 60:6.1f} {s['resident_kib']:13} {s['scene_bytes']:12} {s['projector_bytes']:12} {s['descriptors']:6}"
                f" {s['threads']:8} {s['frames']:8} {counts['edits']:7}",
                flush=True,
            )
        time.sleep(max(0, turn + 1 / options.edits_hz - time.monotonic()))
    return samples


def judge(samples, most, faults):
    """What grew between the end of the warm-up and the end."""
    until_s = max(WARM_UP_S, samples[-1]["at_s"] / 5) if samples else 0
    warm = [s for s in samples if s["at_s"] >= until_s]
    if len(warm) < 4:
        faults.append(f"{len(warm)} samples after a warm-up of {until_s:.0f} s are too few")
        return
    # A sample may catch a buffer one size larger: the least of each half are compared.
    half = len(warm) // 2
    early, late = warm[:half], warm[half:]
    least = [min(s["resident_kib"] for s in part) for part in (early, late)]
    grown = least[1] / least[0] - 1
    print(f"resident memory: {grown:+.2%} from the first half after the warm-up to the second")
    if grown > most:
        faults.append(f"resident memory grew by {grown:.1%}")
    # What goes up and down with clients in the air has leaked where it does not come down again to what it was.
    for key in ("scene_bytes", "projector_bytes", "descriptors", "threads"):
        before, after = max(s[key] for s in early), min(s[key] for s in late)
        if after > before:
            faults.append(f"{key} grew from {before} to {after}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanternd", type=pathlib.Path, default=REPOSITORY / "target/release/lanternd")
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--edits-hz", type=float, default=10, help="lists of edits a second at most")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--most-percent", type=float, default=2, help="that resident memory may grow; a run of less than minutes is mostly warm-up")
    parser.add_argument("--validation", action="store_true", help="with the validation layers, whose memory grows by itself")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        samples, counts, faults = soak(options, pathlib.Path(folder))
    print(", ".join(f"{count} {what}" for what, count in counts.items()))
    judge(samples, options.most_percent / 100, faults)
    for fault in faults:
        print(f"FAULT: {fault}")
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
