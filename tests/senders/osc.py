"""Sends OSC messages by python-osc.

osc.py PORT MESSAGES: MESSAGES is JSON, [[address, argument…], …]; they go in one bundle, or if there is only one, without.
"""

import json
import sys

from pythonosc import osc_bundle_builder, osc_message_builder, udp_client


def message(address, *arguments):
    builder = osc_message_builder.OscMessageBuilder(address=address)
    for argument in arguments:
        builder.add_arg(argument)
    return builder.build()


def main():
    port, messages = int(sys.argv[1]), [message(*parts) for parts in json.loads(sys.argv[2])]
    client = udp_client.UDPClient("127.0.0.1", port)
    if len(messages) == 1:
        client.send(messages[0])
        return
    bundle = osc_bundle_builder.OscBundleBuilder(osc_bundle_builder.IMMEDIATELY)
    for part in messages:
        bundle.add_content(part)
    client.send(bundle.build())


main()
