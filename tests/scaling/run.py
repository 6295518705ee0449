#!/usr/bin/env python3
"""How time and memory grow: with projectors, with triangles, and with nothing to do.

    cargo build --release
    chrt -f 10 tests/scaling/run.py [--parts projectors,triangles,static,memory] …      (--help tells the rest)

projectors   The demo's scene for 1, 2, 4 and 8 projectors of 640 × 400 pixels, all of them copies of the demo's `left` under names of their
             own, so that each has the same work; blending is off, since it grows with pairs. Printed: a `full` and a `viewer` frame over the number of
             projectors, medians over rounds that alternate between the counts.
triangles    One projector in a closed hall (../embree/hall.py) of 10 thousand to 3 million triangles, diffuse, with one point light: a `full`
             frame, and its ratio to the smallest hall's over (log n / log n₀)².
static       `lanternd run` on the demo: processor time of the whole process over ten seconds in which nothing changes.
memory       `lanternd run` on the demo's scene with 1 to 4 projectors of 1280 × 800 pixels and 4 samples: growth of the process's
             resident memory, which on a software driver holds the device's, beside what `status` says.
start        `lanternd run` after a `kill -9`, with everything in the caches: from the start of the process to where the scene is loaded, and from
             there to where it answers, which it does once the first picture stands. Of the demo, and of a hall of a million triangles.

Works on Linux alone (/proc). Halls are kept in target/scaling.
"""

import argparse
import datetime
import json
import math
import os
import pathlib
import re
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time

HERE = pathlib.Path(__file__).resolve().parent
REPOSITORY = HERE.parent.parent
sys.path.insert(0, str(HERE.parent / "embree"))

import hall  # noqa: E402  (it lies in the folder that was just named)

COUNTS = [1, 2, 4, 8]
TRIANGLES = [10_000, 100_000, 1_000_000, 3_000_000]


def demo(projectors, size_px, render):
    """The demo's configuration with so many copies of its left projector."""
    text = (REPOSITORY / "config/demo.toml").read_text()
    head, left = re.split(r"\n\[\[projector\]\]\n(?=name\s+= \"left\")", text)[:2]
    left, _, tail = left.partition("\n[[projector]]\n")
    limits = tail[tail.index("\n# Bounds on what is taken in") :]
    for key, value in render.items():
        head, found = re.subn(rf"(?m)^{key}\s+=\s+\S+", f"{key} = {value}", head)
        if found != 1:
            raise SystemExit(f"the demo's configuration has no {key}")
    # The tracker's port may be taken, and nothing tracks here.
    head = head.replace("127.0.0.1:7000", "127.0.0.1:0")
    left = re.sub(r"resolution_px = .*", f"resolution_px = [{size_px[0]}, {size_px[1]}]", left)
    copies = [re.sub(r'name\s+= "left".*', f'name = "p{i}"', left) for i in range(projectors)]
    return head + "".join(f"\n[[projector]]\n{copy}" for copy in copies) + limits


def bench(options, config, cases, frames):
    words = [str(options.lanternd), "bench", "--json", "--frames", str(frames), "-c", str(config)]
    words += [word for case in cases for word in ("--case", case)]
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(words)}: {done.stderr}")
    # A projector's time ends when the host has seen its end, so the last one's is the frame's.
    found = json.loads(done.stdout)["cases"]
    return {case: max(p["frame_ms"]["p50"] for p in found[case]["projectors"].values()) for case in cases}


def projectors(options):
    cases = ["viewer", "full"]
    configs = {}
    for count in COUNTS:
        configs[count] = options.out / f"projectors-{count}.toml"
        configs[count].write_text(demo(count, (640, 400), {"samples": 1, "blend": "false"}))
    ms = {(count, case): [] for count in COUNTS for case in cases}
    for _ in range(options.rounds):
        for count, config in configs.items():
            for case, value in bench(options, config, cases, options.frames).items():
                ms[count, case].append(value)
    each = {key: statistics.median(values) / key[0] for key, values in ms.items()}
    print("projectors   viewer, ms each   / of one   full, ms each   / of one")
    for count in COUNTS:
        row = [(each[count, case], each[count, case] / each[1, case]) for case in cases]
        print(f"{count:10}   {row[0][0]:15.2f}   {row[0][1]:8.3f}   {row[1][0]:13.2f}   {row[1][1]:8.3f}")


def triangles(options):
    text = (HERE.parent / "embree/hall.toml").read_text()
    light = '\n[[scene.light]]\nname = "lamp"\nkind = "point"\nposition_m = [-2, 4, 0.5]\nintensity = 60.0\n'
    ms, counts, configs = {}, {}, {}
    for asked in TRIANGLES:
        mesh, about = options.out / f"hall-{asked}.glb", options.out / f"hall-{asked}.txt"
        if not mesh.exists() or not about.exists():
            about.write_text(str(hall.write(asked, mesh)))
        counts[asked], ms[asked] = int(about.read_text()), []
        configs[asked] = options.out / f"hall-{asked}.toml"
        configs[asked].write_text(text.replace("../../target/embree/hall.glb", str(mesh)) + light)
    for _ in range(options.rounds):
        for asked, config in configs.items():
            ms[asked].append(bench(options, config, ["full"], options.frames)["full"])
    first = TRIANGLES[0]
    print("triangles   full, ms   / of the first   (log n / log n₀)²")
    for asked in TRIANGLES:
        time_ms = statistics.median(ms[asked])
        ratio, allowed = time_ms / statistics.median(ms[first]), (math.log(counts[asked]) / math.log(counts[first])) ** 2
        print(f"{counts[asked]:9,}   {time_ms:8.1f}   {ratio:14.2f}   {allowed:17.2f}")


class Daemon:
    """`lanternd run`, from its first frame on, until the block ends."""

    def __init__(self, options, config):
        self.folder = tempfile.TemporaryDirectory()
        file, self.socket = pathlib.Path(self.folder.name) / "scaling.toml", str(pathlib.Path(self.folder.name) / "s")
        file.write_text(config)
        words = [str(options.lanternd), "run", "-c", str(file), "--socket", self.socket]
        self.process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def __enter__(self):
        # It answers when it listens; its first frame is another matter, and compiles every shader.
        for _ in range(1200):
            if self.process.poll() is not None:
                raise SystemExit("lanternd has ended; hint: run it by hand")
            try:
                shown = [p["frames"] for p in self.status()["projectors"].values()]
            except OSError:
                shown = []
            if shown and min(shown) > 0:
                return self
            time.sleep(0.1)
        raise SystemExit("lanternd shows no frame")

    def __exit__(self, *_):
        self.process.send_signal(signal.SIGTERM)
        self.process.wait()
        self.folder.cleanup()

    def ask(self, **request):
        with socket.socket(socket.AF_UNIX) as connection:
            connection.connect(self.socket)
            file = connection.makefile("rw")
            file.write(json.dumps({"id": 1, **request}) + "\n")
            file.flush()
            return json.loads(file.readline())["ok"]

    def status(self):
        return self.ask(op="status")

    def cpu_s(self):
        # The name, in brackets, may hold spaces; user and system time are the 14th and 15th field.
        fields = pathlib.Path(f"/proc/{self.process.pid}/stat").read_text().rpartition(")")[2].split()
        return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

    def resident_mib(self):
        pages = int(pathlib.Path(f"/proc/{self.process.pid}/statm").read_text().split()[1])
        return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def static(options):
    with Daemon(options, demo(2, (1280, 800), {})) as daemon:
        time.sleep(3)
        begun, before, frames = time.monotonic(), daemon.cpu_s(), [p["frames"] for p in daemon.status()["projectors"].values()]
        time.sleep(10)
        took_s, cpu_s = time.monotonic() - begun, daemon.cpu_s() - before
        assert frames == [p["frames"] for p in daemon.status()["projectors"].values()], "nothing was to change"
        print(f"static: {100 * cpu_s / took_s:.2f} % of one core over {took_s:.1f} s ({cpu_s:.2f} s of processor time)")


def memory(options):
    print("projectors   resident, MiB   status, MiB of GPU memory")
    points = []
    for count in (1, 2, 3, 4):
        with Daemon(options, demo(count, (1280, 800), {"blend": "true"})) as daemon:
            time.sleep(1)
            status = daemon.status()
            points.append((count, daemon.resident_mib(), sum(p["gpu_bytes"] for p in status["projectors"].values()) / 2**20))
            print("{:10}   {:13.1f}   {:25.1f}".format(*points[-1]))
    each = [(points[-1][i] - points[0][i]) / (points[-1][0] - points[0][0]) for i in (1, 2)]
    print(f"for each more: {each[0]:.1f} MiB of the process, {each[1]:.1f} MiB by status")


def started(options, config):
    """Seconds to the loaded scene, and from there to the first answer; the daemon is killed then, as nobody would wish."""
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "s")
        words = [str(options.lanternd), "run", "-c", str(config), "--socket", path]
        begun = time.time()
        with open(os.path.join(folder, "log"), "w+") as log:
            process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=log, env={**os.environ, "NO_COLOR": "1"})
            while True:
                if process.poll() is not None:
                    raise SystemExit("lanternd has ended; hint: run it by hand")
                try:
                    with socket.socket(socket.AF_UNIX) as connection:
                        connection.connect(path)
                        connection.sendall(b'{"id": 1, "op": "hello"}\n')
                        if connection.recv(1):
                            break
                except OSError:
                    time.sleep(0.002)
            answered = time.time()
            process.kill()
            process.wait()
            log.seek(0)
            loaded = next(line.split()[0] for line in log if "structures built=" in line)
            loaded = datetime.datetime.fromisoformat(loaded.replace("Z", "+00:00")).timestamp()
            return loaded - begun, answered - loaded


def start(options):
    mesh, hall_config = options.out / "hall-1000000.glb", options.out / "start-hall.toml"
    if not mesh.exists():
        hall.write(1_000_000, mesh)
    hall_config.write_text((HERE.parent / "embree/hall.toml").read_text().replace("../../target/embree/hall.glb", str(mesh)))
    demo_config = options.out / "start-demo.toml"
    demo_config.write_text(demo(1, (1280, 800), {}))
    print("scene   scene loaded, s   from there to the picture, s")
    for name, config in (("demo", demo_config), ("hall", hall_config)):
        # The first one fills the caches.
        times = [started(options, config) for _ in range(options.rounds + 1)][1:]
        print("{}   {:15.2f}   {:28.2f}".format(name, *(statistics.median(column) for column in zip(*times))))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanternd", type=pathlib.Path, default=REPOSITORY / "target/release/lanternd", help="the program to measure")
    parser.add_argument("--out", type=pathlib.Path, default=REPOSITORY / "target/scaling", help="where halls and configurations go")
    parser.add_argument("--parts", default="projectors,triangles,static,memory", help="which")
    parser.add_argument("--rounds", type=int, default=3, help="by turns")
    parser.add_argument("--frames", type=int, default=3, help="of `bench` in each round")
    options = parser.parse_args()
    options.out = options.out.resolve()
    options.out.mkdir(parents=True, exist_ok=True)
    if not options.lanternd.exists():
        raise SystemExit(f"there is no {options.lanternd}; hint: cargo build --release")
    parts = {"projectors": projectors, "triangles": triangles, "static": static, "memory": memory, "start": start}
    for name in options.parts.split(","):
        parts[name](options)
        print()


if __name__ == "__main__":
    main()
