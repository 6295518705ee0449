#!/usr/bin/env python3
"""How fast we trace, against Embree 3 on the same rays and the same cores, in one interleaved run.

    cargo build --release
    tests/embree/run.py [--rounds N] [--scenes bunny,hall,demo] …      (--help tells the rest)

Needs a C++ compiler and Debian's `libembree-dev`; what it builds and writes lies in target/embree. Real-time priority and an otherwise
idle machine make its figures worth having: `chrt -f 10 tests/embree/run.py`.

What is compared
    For each scene and look, `lanternd bench --dump` writes down the rays that the passes of one frame trace, and trace.cpp traces
    those with Embree: single rays and packets of sixteen neighbours, in structures of Embree's default ("medium") and best ("high")
    build quality, on as many threads as there are cores. Rays stand in the files along a Morton curve over the image, pixel by pixel
    and sample by sample, which is as coherent as a tracer on the CPU could have them.

    Rounds alternate: `lanternd bench`, Embree medium, Embree high, `lanternd bench`, …; each figure is the median of its rounds.
    Embree's ratio is taken against the faster of its two structures.

    Ours is the rate inside the real passes, by the device's timestamps around them. `primary` also makes each ray of its pixel and
    jitter, and writes the hit and the closest sample. `secondary` (mirror, rough) also finds the primary hit's surface again, makes
    the ray of it by the material's lobe, fetches the material at what the ray hits and adds its look; these scenes have no light, so
    it traces no shadow ray, and max_depth = 1, so each ray is a first bounce. Embree's time holds tracing alone.

    A hit agrees where both tracers hit nothing, or something within 1e-4 (relative above a metre) of the same distance; or, where any
    hit will do, anything. Shadow rays that go on behind glass are traced and timed, and left out of that.

Scenes
    bunny   The Stanford bunny alone, 69,451 triangles, of the folder of real models beside the checkout; skipped where it is absent.
    hall    A closed hall of a million triangles (hall.py): every ray hits.
    demo    The demo's own scene: what a frame of each case takes, against what Embree needs merely to trace the `full` frame's rays.
"""

import argparse
import json
import math
import os
import pathlib
import statistics
import subprocess
import sys

import hall

HERE = pathlib.Path(__file__).resolve().parent
REPOSITORY = HERE.parent.parent

# Of the model's one material.
LOOKS = {
    "mirror": "base_color = [1, 1, 1]\nmetallic = 1.0\nroughness = 0.0\n",
    "rough": "base_color = [1, 1, 1]\nmetallic = 1.0\nroughness = 1.0\n",
}
# Which kind of ray of which look is which row of the table. What a primary ray hits does not depend on the look.
ROWS = [("primary", "mirror", "primary"), ("mirror", "mirror", "secondary"), ("diffuse", "rough", "secondary")]


def run(command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if done.returncode != 0:
        raise SystemExit(f"{' '.join(map(str, command))}: {done.stderr}")
    return done.stdout


class Bench:
    """The two tracers of one run."""

    def __init__(self, options):
        self.options = options
        options.out.mkdir(parents=True, exist_ok=True)
        self.tracer = options.out / "trace"
        source = HERE / "trace.cpp"
        if not self.tracer.exists() or self.tracer.stat().st_mtime < source.stat().st_mtime:
            flags = ["-std=c++17", "-O3", "-march=native", "-Wall", "-Wextra"]
            run([options.cxx, *flags, source, "-o", self.tracer, "-lembree3", "-pthread"])

    def ours(self, config, cases, frames, dump=None):
        more = [word for case in cases for word in ("--case", case)]
        more += ["-c", config] if config else []
        more += ["--dump", dump] if dump else []
        return json.loads(run([self.options.lanternd, "bench", "--json", "--frames", frames, *more]))

    def embree(self, dump, kinds, quality):
        asked = []
        for kind in kinds:
            about = dump["told"]["kinds"][kind]
            asked.append(f"{kind}:{about['hit']}:{about['first_triangle']}:{about['triangles']}")
        threads, seconds = self.options.threads, self.options.seconds
        return json.loads(run([self.tracer, dump["folder"], threads, seconds, quality, *asked]))["kinds"]

    def dump(self, name, config):
        folder = self.options.out / name
        if self.options.reuse and (folder / "dump.json").exists():
            return {"folder": folder, "told": json.loads((folder / "dump.json").read_text())}
        return {"folder": folder, "told": self.ours(config, ["full"], 1, folder)["dump"]}


def with_look(scene, look, options):
    """A configuration beside the others that differs in the material, and names files by whole paths."""
    text = (HERE / f"{scene}.toml").read_text()
    text = text.replace("../../../shared/data/models", str(options.models)).replace("../../target/embree", str(options.out))
    path = options.out / f"{scene}-{look}.toml"
    path.write_text(f'{text}\n[[scene.material]]\nname = "plaster"\n{LOOKS[look]}')
    return path


def of_scene(bench, scene):
    """The table's rows of a scene."""
    options = bench.options
    configs = {look: with_look(scene, look, options) for look in LOOKS}
    dumps = {look: bench.dump(f"{scene}-{look}", config) for look, config in configs.items()}
    kinds = {look: [kind for _, of, kind in ROWS if of == look] for look in LOOKS}
    ours = {row: [] for row, _, _ in ROWS}
    theirs = {row: {} for row, _, _ in ROWS}
    for number in range(options.rounds):
        print(f"{scene}: round {number + 1} of {options.rounds}", file=sys.stderr)
        for look, config in configs.items():
            full = bench.ours(config, ["full"], options.frames)["cases"]["full"]["projectors"]
            for row, of, kind in ROWS:
                if of == look:
                    ours[row].append(statistics.mean(p["mray_s"][kind] for p in full.values()))
            for quality in ("medium", "high"):
                found = bench.embree(dumps[look], kinds[look], quality)
                for row, of, kind in ROWS:
                    if of == look:
                        for key, value in found[kind].items():
                            theirs[row].setdefault((quality, key), []).append(value)
    for row, _, _ in ROWS:
        median = {key: statistics.median(values) for key, values in theirs[row].items()}
        yield row, statistics.median(ours[row]), median


def table(header, rows):
    widths = [max(len(row[column]) for row in [header, *rows]) for column in range(len(header))]
    for row in [header, ["-" * width for width in widths], *rows]:
        print("| " + " | ".join(cell.ljust(width) for cell, width in zip(row, widths)) + " |")


def scenes(bench, names):
    rows, ratios, primaries = [], [], []
    for scene in names:
        for row, ours, theirs in of_scene(bench, scene):
            single = max(theirs[(quality, "single_mray_s")] for quality in ("medium", "high"))
            packets = max(theirs[(quality, "packet_mray_s")] for quality in ("medium", "high"))
            agreeing = min(theirs[(quality, "agreeing")] for quality in ("medium", "high"))
            ratios.append(ours / single)
            if row == "primary":
                primaries.append(ours / single)
            numbers = [ours, *(theirs[(q, k)] for k in ("single_mray_s", "packet_mray_s") for q in ("medium", "high"))]
            rays = f"{int(theirs[('high', 'rays')]):,}"
            shares = [f"{ours / single:.2f}", f"{ours / packets:.2f}", f"{100 * agreeing:.4f} %"]
            rows.append([scene, row, rays, *(f"{x:.2f}" for x in numbers), *shares])
    table(
        ["scene", "rays", "number", "ours", "Embree single, medium", "single, high", "16, medium", "16, high", "ours / single", "ours / 16", "hits agree"],
        rows,
    )
    mean = lambda x: math.exp(statistics.mean(map(math.log, x)))
    print(f"\nMray/s; ours / Embree's single rays: geometric mean {mean(ratios):.3f}, primary alone {mean(primaries):.3f}")


def demo(bench):
    options = bench.options
    dump = bench.dump("demo", None)
    kinds = [kind for kind, about in dump["told"]["kinds"].items() if sum(about["rays"].values()) > 0]
    cases = {"static": [], "viewer": [], "node": [], "full": []}
    alone, best, agreeing = [], [], 1.0
    for number in range(options.rounds):
        print(f"demo: round {number + 1} of {options.rounds}", file=sys.stderr)
        found = bench.ours(None, list(cases), options.frames)["cases"]
        for case, times in cases.items():
            # A projector's time ends when the host has seen its end, so the last one's is the frame's.
            times.append(max(p["frame_ms"]["p50"] for p in found[case]["projectors"].values()))
        by_quality = [bench.embree(dump, kinds, quality) for quality in ("medium", "high")]
        ms = lambda kind, keys: min(of[kind]["rays"] / of[kind][key] / 1e3 for of in by_quality for key in keys)
        agreeing = min(agreeing, *(found["agreeing"] for of in by_quality for found in of.values()))
        alone.append(sum(ms(kind, ["single_mray_s"]) for kind in kinds))
        best.append(sum(ms(kind, ["single_mray_s", "packet_mray_s"]) for kind in kinds))
    median = {case: statistics.median(times) for case, times in cases.items()}
    print()
    table(["demo, all projectors", "ms", "/ full"], [[c, f"{t:.3f}", f"{t / median['full']:.4f}"] for c, t in median.items()])
    rays = sum(sum(dump["told"]["kinds"][kind]["rays"].values()) for kind in kinds)
    print(f"\nEmbree, to trace the {rays:,} rays of `full` and nothing else: {statistics.median(alone):.0f} ms by single rays, ", end="")
    print(f"{statistics.median(best):.0f} ms by whichever of single rays and packets is faster for each kind;")
    print(f"`viewer` / that: {median['viewer'] / statistics.median(alone):.3f} and {median['viewer'] / statistics.median(best):.3f};", end=" ")
    print(f"of no kind do less than {100 * agreeing:.4f} % of the hits agree")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanternd", type=pathlib.Path, default=REPOSITORY / "target/release/lanternd", help="the program to measure")
    parser.add_argument("--models", type=pathlib.Path, default=REPOSITORY.parent / "shared/data/models", help="where real models are")
    parser.add_argument("--out", type=pathlib.Path, default=REPOSITORY / "target/embree", help="what is built and written")
    parser.add_argument("--scenes", default="bunny,hall,demo", help="which, of bunny, hall and demo")
    parser.add_argument("--triangles", type=int, default=1_000_000, help="of the hall")
    parser.add_argument("--rounds", type=int, default=3, help="of ours and theirs by turns")
    parser.add_argument("--frames", type=int, default=3, help="of `bench` in each round")
    parser.add_argument("--seconds", type=float, default=1.0, help="of Embree for each kind of ray in each round")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)), help="of Embree")
    parser.add_argument("--reuse", action="store_true", help="the rays of an earlier run; of the same scenes and program, please")
    parser.add_argument("--cxx", default="c++", help="the C++ compiler")
    options = parser.parse_args()
    options.out, options.models = options.out.resolve(), options.models.resolve()
    if not options.lanternd.exists():
        raise SystemExit(f"there is no {options.lanternd}; hint: cargo build --release")
    bench = Bench(options)

    wanted = options.scenes.split(",")
    if "bunny" in wanted and not (options.models / "stanford-bunny.glb").exists():
        print(f"bunny is skipped: there is no {options.models / 'stanford-bunny.glb'}", file=sys.stderr)
        wanted.remove("bunny")
    if "hall" in wanted:
        about = options.out / "hall.txt"
        if not (options.out / "hall.glb").exists() or not about.exists() or about.read_text() != str(options.triangles):
            print("writing the hall", file=sys.stderr)
            hall.write(options.triangles, options.out / "hall.glb")
            about.write_text(str(options.triangles))
    named = [scene for scene in wanted if scene in ("bunny", "hall")]
    if named:
        scenes(bench, named)
    if "demo" in wanted:
        demo(bench)


if __name__ == "__main__":
    main()
