#!/usr/bin/env python3
"""Reads a page of metrics as Prometheus' own client library does: URL → a JSON list of families (Debian: python3-prometheus-client)."""

import json
import sys
import urllib.request

from prometheus_client.parser import text_string_to_metric_families

with urllib.request.urlopen(sys.argv[1], timeout=20) as response:
    kind = response.headers["Content-Type"]
    page = response.read().decode("utf-8")
families = [
    {
        "name": family.name,
        "type": family.type,
        "help": family.documentation,
        "samples": [{"name": s.name, "labels": s.labels, "value": s.value} for s in family.samples],
    }
    for family in text_string_to_metric_families(page)
]
json.dump({"content_type": kind, "families": families}, sys.stdout)
