#!/usr/bin/python3
"""Receives what `kinevox-bridge vmc` sends and prints the bones; needs nothing but Python.

usage: receive_vmc.py [--port 39539] [--seconds 0]"""
import argparse
import socket
import struct
import time


def text(data, at):
    """A null-terminated text, padded to four bytes; and what follows it."""
    end = data.index(b"\0", at)
    return data[at:end].decode(), end // 4 * 4 + 4


def messages(data):
    """(address, arguments) of all messages in an OSC packet."""
    if data.startswith(b"#bundle\0"):
        at = 16
        while at < len(data):
            (size,) = struct.unpack_from(">i", data, at)
            yield from messages(data[at + 4 : at + 4 + size])
            at += 4 + size
        return
    address, at = text(data, 0)
    kinds, at = text(data, at)
    arguments = []
    for kind in kinds[1:]:
        if kind == "s":
            value, at = text(data, at)
        else:
            (value,), at = struct.unpack_from(">f" if kind == "f" else ">i", data, at), at + 4
        arguments.append(value)
    yield address, arguments


def receive(port, seconds=0, host="127.0.0.1"):
    """Yields (time of the sender in s, {bone: (position xyz in m, rotation xyzw)}) per pose, for the given time (s; 0: for ever)."""
    end = time.monotonic() + seconds
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind((host, port))
        receiver.settimeout(0.5)
        at_s, bones, complete = None, {}, False
        while not seconds or time.monotonic() < end:
            try:
                data = receiver.recv(65536)
            except TimeoutError:
                continue
            for address, arguments in messages(data):
                if address == "/VMC/Ext/OK":
                    if complete and bones:
                        yield at_s, bones
                    bones, complete = {}, arguments[0] == 1
                elif address == "/VMC/Ext/T":
                    at_s = arguments[0]
                elif address == "/VMC/Ext/Bone/Pos":
                    bones[arguments[0]] = tuple(arguments[1:4]), tuple(arguments[4:8])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", type=int, default=39539)
    parser.add_argument("--seconds", type=float, default=0)
    arguments = parser.parse_args()
    for at_s, bones in receive(arguments.port, arguments.seconds):
        position, rotation = bones["Hips"]
        print(
            f"{at_s:8.3f} s  {len(bones)} bones, hips at {position[0]:.2f} {position[1]:.2f} {position[2]:.2f} m, "
            f"left knee {[round(v, 3) for v in bones['LeftLowerLeg'][1]]}",
            flush=True,
        )


if __name__ == "__main__":
    main()
