#!/usr/bin/env python3
"""A list of edits that no line could hold, in a sealed memfd: SOCKET COUNT moves the node `ball` COUNT times, and prints the answer."""

import fcntl
import json
import os
import socket
import sys

path, count = sys.argv[1], int(sys.argv[2])
edits = [{"set": {"node": "ball", "translation_m": [turn / count, 0.4, 0]}} for turn in range(1, count + 1)]

memfd = os.memfd_create("edits", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
with os.fdopen(memfd, "wb") as file:
    file.write(json.dumps(edits).encode())
    file.flush()
    fcntl.fcntl(memfd, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_GROW | fcntl.F_SEAL_WRITE)
    daemon = socket.socket(socket.AF_UNIX)
    daemon.connect(path)
    request = {"id": 1, "op": "scene.apply", "edits": "fd:0", "durable": False}
    socket.send_fds(daemon, [json.dumps(request).encode() + b"\n"], [memfd])
print(daemon.makefile().readline(), end="")
