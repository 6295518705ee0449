#!/usr/bin/env python3
"""The order in which a durable edit reaches the disk, as the kernel sees it (strace): what a loss of power asks for.

    tests/kill/order.py [--lanternd PROGRAM]

The new file is written and synced before its name replaces the old one's; the folder is synced after that; and the client is answered after
both. So at no moment does the disk hold less than what was acknowledged, whatever it has reordered in between. Ends with 1 where the order
is another; with 0, and a word, where this machine does not let anybody trace.
"""

import argparse
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "clients"))

from lantern import REPOSITORY, Daemon  # noqa: E402  (it lies in the folder that was just named)

CONFIG = """
[daemon]
state_dir = "state"
[render]
samples = 1
[[scene.node]]
name = "ball"
uri = "lantern:quad"
[[projector]]
name = "left"
resolution_px = [64, 40]
[projector.calibration]
convention = "opengl"
projection = [[1.5, 0, 0, 0], [0, 2.4, 0, 0], [0, 0, -1.02, -0.2], [0, 0, -1, 0]]
view = [[1, 0, 0, 0], [0, 0.8, -0.6, 0.3], [0, 0.6, 0.8, -3], [0, 0, 0, 1]]
"""

CALLS = "openat,write,pwrite64,fsync,fdatasync,rename,renameat,renameat2,sendto,sendmsg"

# What must come one after the other, as strace -y tells it.
WANTED = [
    r'write\(\d+<[^>]*/state/scene\.json\.new>',
    r"f(data)?sync\(\d+<[^>]*/state/scene\.json\.new>\)\s+= 0",
    r'rename(at2?)?\(.*scene\.json\.new".*scene\.json".*= 0',
    r"fsync\(\d+<[^>]*/state>\)\s+= 0",
    r'(write|sendto|sendmsg)\(\d+<[^>]*>.*revision',
]


def can_trace():
    if shutil.which("strace") is None:
        return "there is no strace; hint: packaging/test installs it"
    tried = subprocess.run(["strace", "-o", "/dev/null", "true"], capture_output=True, text=True)
    return None if tried.returncode == 0 else f"nobody may trace here: {tried.stderr.strip()}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--lanternd", type=pathlib.Path, default=REPOSITORY / "target/release/lanternd")
    options = parser.parse_args()
    if why := can_trace():
        print(f"skipped: {why}")
        return 0
    with tempfile.TemporaryDirectory() as folder:
        folder = pathlib.Path(folder)
        (folder / "order.toml").write_text(CONFIG)
        trace = folder / "trace"
        # -f, since a worker of the daemon's writes.
        before = ["strace", "-f", "-qq", "-y", "-s", "4096", "-e", f"trace={CALLS}", "-o", str(trace)]
        daemon = Daemon(options.lanternd, folder / "order.toml", folder / "lanternd.sock", folder / "log", before=before)
        try:
            client = daemon.connect()
            for x in (0.25, 0.5):
                client.ask("scene.apply", edits=[{"set": {"node": "ball", "translation_m": [x, 0, 0]}}])
            client.close()
        finally:
            # strace ends as the daemon does, which is its child. A signal to strace would leave that behind.
            tracer = daemon.process.pid
            for child in pathlib.Path(f"/proc/{tracer}/task/{tracer}/children").read_text().split():
                os.kill(int(child), signal.SIGTERM)
            daemon.process.wait(30)
        lines = trace.read_text(errors="replace").splitlines()
    # A call that another thread's came into stands on two lines; its end is what counts.
    calls, begun = [], {}
    for line in lines:
        thread, _, call = line.partition(" ")
        call = call.strip()
        if call.endswith("<unfinished ...>"):
            begun[thread] = call.removesuffix("<unfinished ...>")
        elif found := re.match(r"<\.\.\. \w+ resumed>(.*)", call):
            calls.append(begun.pop(thread, "") + found[1])
        else:
            calls.append(call)
    rounds, at = 0, 0
    for call in calls:
        if re.match(WANTED[at], call):
            at += 1
        elif any(re.match(wanted, call) for wanted in WANTED[at + 1 :] if "revision" not in wanted or at > 0):
            print(f"FAULT: where `{WANTED[at]}` was to come there came: {call[:300]}")
            return 1
        if at == len(WANTED):
            rounds, at = rounds + 1, 0
    if rounds != 2:
        print(f"FAULT: {rounds} edits went to the disk in order, and 2 were acknowledged; of the next, {at} steps did")
        return 1
    print("2 edits: written, synced, renamed, the folder synced, and then answered")
    return 0


if __name__ == "__main__":
    sys.exit(main())
