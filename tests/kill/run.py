#!/usr/bin/env python3
"""`kill -9` at random moments under streams of durable edits: what was acknowledged is there again, and nothing of it half.

    cargo build --release
    tests/kill/run.py [--times 200] [--seed N] …      (--help tells the rest)

Two clients send durable edits as fast as they are answered. Each list carries a number in four places at once: where three nodes stand, and in
the name of a node that takes the place of the one before. After each kill the daemon is started again; what it then shows must have the same
number in all four, no less than the last that was acknowledged and no more than the last that was sent, under a revision no less
than the acknowledged one. The kill comes up to 300 ms after the first answer of a run, and one time in ten while the daemon starts. A
hundred nodes stand by, so that what is written has some length.

Beside that: no start sets anything aside or says an error, nothing piles up in the state's folder or the cache's. Printed at the end: the
times from the start of the process to its first answer, which comes after its first picture. Ends with 1 where anything of it does not hold.
"""

import argparse
import contextlib
import json
import pathlib
import random
import statistics
import sys
import tempfile
import threading
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "clients"))

from lantern import REPOSITORY, Daemon, Gone  # noqa: E402  (it lies in the folder that was just named)

WRITERS = ["a", "b"]
BYSTANDERS = 100

PROJECTOR = """
[[projector]]
name = "left"
resolution_px = [64, 40]
output = { kind = "headless", refresh_hz = 1000 }
[projector.calibration]
convention = "opengl"
projection = [[1.5, 0, 0, 0], [0, 2.4, 0, 0], [0, 0, -1.02, -0.2], [0, 0, -1, 0]]
view = [[1, 0, 0, 0], [0, 0.8, -0.6, 0.3], [0, 0.6, 0.8, -3], [0, 0, 0, 1]]
"""


def config():
    nodes = [f"{writer}{place}" for writer in WRITERS for place in range(3)] + [f"{writer}-0" for writer in WRITERS]
    nodes += [f"bystander{place}" for place in range(BYSTANDERS)]
    node = '[[scene.node]]\nname = "%s"\nuri = "lantern:quad"\nrole = "virtual"\n'
    return '[daemon]\nstate_dir = "state"\n[render]\nsamples = 1\n' + "".join(node % name for name in nodes) + PROJECTOR


class Writer:
    """A client's stream, over all runs of the daemon."""

    def __init__(self, name):
        self.name = name
        self.sent = self.acknowledged = self.revision = self.there = 0

    def edits(self, number):
        moves = [{"set": {"node": f"{self.name}{place}", "translation_m": [number, place, 0]}} for place in range(3)]
        tag = {"add": {"node": f"{self.name}-{number}", "uri": "lantern:quad", "role": "virtual"}}
        return [moves[0], {"remove": {"node": f"{self.name}-{self.there}"}}, moves[1], tag, moves[2]]

    def stream(self, daemon, answered):
        with contextlib.suppress(Gone, OSError):
            client = daemon.connect()
            while True:
                self.sent += 1
                answer = client.ask("scene.apply", edits=self.edits(self.sent))
                if not answer["durable"]:
                    raise SystemExit(f"{answer} is not durable")
                self.acknowledged = self.there = self.sent
                self.revision = answer["revision"]
                answered.set()

    def judge(self, scene, faults):
        """What of it is there after a restart; the stream goes on from that."""
        added = [edit["add"] for edit in scene["edits"] if "add" in edit]
        numbers = [int(add["translation_m"][0]) if "translation_m" in add else 0 for add in added if add["node"] in self.places()]
        numbers += [int(add["node"].split("-")[1]) for add in added if add["node"].startswith(f"{self.name}-")]
        if len(numbers) != 4 or len(set(numbers)) != 1:
            faults.append(f"{self.name} is half applied: {numbers}")
            raise SystemExit(report(faults))
        self.there = numbers[0]
        if not self.acknowledged <= self.there <= self.sent:
            faults.append(f"{self.name}: {self.there} is there, {self.acknowledged} was acknowledged and {self.sent} sent")
        if scene["revision"] < self.revision:
            faults.append(f"{self.name}: revision {scene['revision']} is there, {self.revision} was acknowledged")
        unanswered = self.there > self.acknowledged
        self.sent = self.acknowledged = self.there
        return unanswered

    def places(self):
        return [f"{self.name}{place}" for place in range(3)]


def report(faults):
    for fault in faults:
        print(f"FAULT: {fault}")
    return 1 if faults else 0


def strays(folder):
    """What lies in the folders of the state and of the cache and should not."""
    there = {str(path.relative_to(folder)) for path in (folder / "state").rglob("*") if path.is_file()}
    there -= {"state/scene.json", "state/last-good/configuration.json"}
    there |= {str(path.relative_to(folder)) for path in (folder / "cache").rglob("*.new-*")}
    # The very next start removes what a kill has left of the file that was being written.
    return there


def one_life(daemon, writers, chance, faults):
    """Looks at what a start has brought back, streams, and kills; tells whether more had been kept than answered."""
    client = daemon.connect()
    scene = client.ask("scene.get")
    first_answer_s = time.monotonic() - daemon.started
    more = [writer.judge(scene, faults) for writer in writers]
    client.close()
    answered = threading.Event()
    threads = [threading.Thread(target=writer.stream, args=(daemon, answered)) for writer in writers]
    for thread in threads:
        thread.start()
    answered.wait(60)
    time.sleep(chance.uniform(0, 0.3))
    daemon.kill()
    for thread in threads:
        thread.join()
    return first_answer_s, any(more)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanternd", type=pathlib.Path, default=REPOSITORY / "target/release/lanternd")
    parser.add_argument("--times", type=int, default=200)
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 32))
    parser.add_argument("--validation", action="store_true", help="with the validation layers")
    options = parser.parse_args()
    print(f"seed {options.seed}")
    chance, writers, faults, starts_s, unanswered = random.Random(options.seed), [Writer(name) for name in WRITERS], [], [], 0
    early = 0
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "kill.toml").write_text(config())
        for time_of in range(options.times + 1):
            daemon = Daemon(options.lanternd, folder / "kill.toml", folder / "lanternd.sock", folder / "log", options.validation)
            try:
                if time_of > 0 and chance.randrange(10) == 0:
                    time.sleep(chance.uniform(0, 1) * (statistics.median(starts_s) if starts_s else 1))
                    early += 1
                else:
                    start_s, more = one_life(daemon, writers, chance, faults)
                    starts_s.append(start_s)
                    unanswered += more
            finally:
                daemon.kill()
            log = daemon.log.read_text(errors="replace")
            faults += [f"log of start {time_of}: {line}" for line in log.splitlines() if " ERROR " in line or "set aside" in line]
            faults += [f"log of start {time_of}: {line}" for line in daemon.ills()]
            left = strays(folder) - {"state/scene.json.new", "state/last-good/configuration.json.new"}
            faults += [f"after start {time_of} there is {name}" for name in sorted(left)]
            if len(faults) > 20:
                break
        kept_bytes = (folder / "state/scene.json").stat().st_size
    starts_s.sort()
    print(
        json.dumps(
            {
                "kills": len(starts_s) + early,
                "of them while it started": early,
                "edits acknowledged": sum(writer.acknowledged for writer in writers),
                "kills after an edit was kept and before it was answered": unanswered,
                "bytes of the kept scene": kept_bytes,
                "start to first answer, s": {"p50": round(statistics.median(starts_s), 3), "max": round(starts_s[-1], 3)},
            },
            indent=1,
        )
    )
    sys.exit(report(faults))


if __name__ == "__main__":
    main()
