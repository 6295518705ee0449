#!/usr/bin/env python3
"""What a running show notices of a file of a million triangles that is added to it.

    cargo build --release
    chrt -f 10 tests/loading/run.py [--rounds N] …      (--help tells the rest)

`lanternd run` on the demo's scene with two projectors of 48 × 32 pixels and 1 sample, whose frames a software driver makes at 30 Hz. The eye
moves 90 times a second; ten times a second a client changes a material and waits for the answer. First so for a while, and then while another
client adds a hall (../embree/hall.py) of a million triangles under the floor, from a start whose cache of structures is empty. The first round
is not to be counted where the driver compiles shaders for buffers of these sizes for the first time, as lavapipe does.

Printed for both: percentiles of the time from frame to frame, of the time that the small edits waited, and, of the hall, how long its client did.
Frames are seen by asking `status` every two milliseconds, which is how sharp the times are.
"""

import argparse
import importlib.util
import json
import math
import os
import pathlib
import re
import socket
import tempfile
import threading
import time

HERE = pathlib.Path(__file__).resolve().parent
REPOSITORY = HERE.parent.parent

# Its daemon and its halls.
spec = importlib.util.spec_from_file_location("scaling", HERE.parent / "scaling/run.py")
scaling = importlib.util.module_from_spec(spec)
spec.loader.exec_module(scaling)


class Client:
    """One connection, whose requests are answered in turn."""

    def __init__(self, path):
        self.connection = socket.socket(socket.AF_UNIX)
        self.connection.connect(path)
        self.file = self.connection.makefile("rw")

    def ask(self, **request):
        self.file.write(json.dumps({"id": 1, **request}) + "\n")
        self.file.flush()
        answer = json.loads(self.file.readline())
        if "ok" not in answer:
            raise SystemExit(f"{request['op']} is refused: {answer['error']['message']}")
        return answer["ok"]


class Show:
    """What goes on in a daemon until the block ends: an eye that moves, small edits, and who writes down when frames come."""

    def __init__(self, path):
        self.path, self.over = path, threading.Event()
        self.frames_ms, self.edits_ms = [], []
        self.threads = [threading.Thread(target=what) for what in (self.move, self.edit, self.watch)]

    def __enter__(self):
        for thread in self.threads:
            thread.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        for thread in self.threads:
            thread.join()

    def move(self):
        client, turn = Client(self.path), 0
        while not self.over.wait(1 / 90):
            turn += 1
            client.ask(op="pose", body="head", position_m=[0.3 * math.sin(turn / 30), 1.6, 2.2], orientation=[0, 0, 0, 1])

    def edit(self):
        client, turn = Client(self.path), 0
        while not self.over.wait(0.1):
            turn += 1
            begun = time.monotonic()
            client.ask(op="scene.apply", edits=[{"material": {"name": "mirror/sphere", "roughness": 0.001 * (turn % 2)}}])
            self.edits_ms.append(1e3 * (time.monotonic() - begun))

    def watch(self):
        client, last, since = Client(self.path), None, None
        while not self.over.wait(0.002):
            frames, now = client.ask(op="status")["projectors"]["p0"]["frames"], time.monotonic()
            if last is not None and frames > last:
                self.frames_ms += [1e3 * (now - since) / (frames - last)] * (frames - last)
            if frames != last:
                last, since = frames, now
        # A frame that has yet to come is late already.
        if since is not None:
            self.frames_ms.append(1e3 * (time.monotonic() - since))


def row(what, show):
    def at(values, q):
        return sorted(values)[min(int(q * len(values)), len(values) - 1)]

    frames = " ".join(f"{at(show.frames_ms, q):9.1f}" for q in (0.5, 0.95, 0.99, 1))
    print(f"{what:14} {len(show.frames_ms):6} {frames} {at(show.edits_ms, 0.5):12.1f} {max(show.edits_ms):9.1f}", flush=True)


def give_way(pid):
    """The thread that builds has a low priority by its nice value, which real-time scheduling does not look at: there it gets the lowest."""
    if os.sched_getscheduler(0) not in (os.SCHED_FIFO, os.SCHED_RR):
        return
    tasks = pathlib.Path(f"/proc/{pid}/task")
    builders = [int(task.name) for task in tasks.iterdir() if (task / "comm").read_text().strip() == "structures"]
    if not builders:
        raise SystemExit("the daemon has no thread that builds structures")
    for thread in builders:
        os.sched_setscheduler(thread, os.SCHED_FIFO, os.sched_param(1))


def once(options, mesh):
    config = scaling.demo(2, (48, 32), {"samples": 1})
    config = config.replace("asset_roots = []", f"asset_roots = [{json.dumps(str(mesh.parent))}]")
    config, found = re.subn(r"refresh_hz = \d+", "refresh_hz = 30", config)
    if found != 2:
        raise SystemExit("the demo's projectors have no refresh_hz")
    with tempfile.TemporaryDirectory() as cache:
        # No structure that an earlier run has built, but what the driver has compiled.
        os.environ["CACHE_DIRECTORY"] = cache
        with scaling.Daemon(options, config) as daemon:
            give_way(daemon.process.pid)
            with Show(daemon.socket):
                time.sleep(2)
            with Show(daemon.socket) as quiet:
                time.sleep(options.quiet_s)
            row("quiet", quiet)
            with Show(daemon.socket) as loading:
                begun = time.monotonic()
                hall = {"node": "hall", "uri": mesh.name, "translation_m": [0, -20, 0]}
                Client(daemon.socket).ask(op="scene.apply", edits=[{"add": hall}])
                took_s = time.monotonic() - begun
            row("while loading", loading)
            print(f"{'':14} the hall is shown after {took_s:.2f} s")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanternd", type=pathlib.Path, default=REPOSITORY / "target/release/lanternd", help="the program to measure")
    parser.add_argument("--out", type=pathlib.Path, default=REPOSITORY / "target/scaling", help="where the hall goes")
    parser.add_argument("--triangles", type=int, default=1_000_000, help="of the hall, about")
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--quiet-s", type=float, default=6, help="of the show without the hall")
    options = parser.parse_args()
    options.out = options.out.resolve()
    options.out.mkdir(parents=True, exist_ok=True)
    mesh, about = options.out / f"hall-{options.triangles}.glb", options.out / f"hall-{options.triangles}.txt"
    if not mesh.exists() or not about.exists():
        about.write_text(str(scaling.hall.write(options.triangles, mesh)))
    print("ms             frames       p50       p95       p99   longest   an edit: p50   longest")
    for _ in range(options.rounds):
        once(options, mesh)


if __name__ == "__main__":
    main()
