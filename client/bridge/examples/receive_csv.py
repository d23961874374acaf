#!/usr/bin/python3
"""Receives what `kinevox-bridge csv` sends and prints chosen columns; needs nothing but Python.

usage: receive_csv.py [--port 50780] [--seconds 0] [COLUMN ...]"""
import argparse
import socket
import time


def receive(port, seconds=0, host="127.0.0.1"):
    """Yields {column: number, or None where it was withheld} per pose, for the given time (s; 0: for ever)."""
    end = time.monotonic() + seconds
    columns = None
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind((host, port))
        receiver.settimeout(0.5)
        while not seconds or time.monotonic() < end:
            try:
                cells = receiver.recv(65536).decode().rstrip("\n").split(",")
            except TimeoutError:
                continue
            if cells[0] == "frame":
                columns = cells
            elif columns:  # else it began before we listened; the names come within two seconds
                yield {name: float(cell) if cell else None for name, cell in zip(columns, cells)}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--port", type=int, default=50780)
    parser.add_argument("--seconds", type=float, default=0)
    parser.add_argument("columns", nargs="*", default=["knee_flexion_geometric_l_deg", "knee_flexion_geometric_r_deg"])
    arguments = parser.parse_args()
    for row in receive(arguments.port, arguments.seconds):
        print(
            f"{row['time_s']:8.3f} s  " + "  ".join(f"{name} {row.get(name)}" for name in arguments.columns), flush=True
        )


if __name__ == "__main__":
    main()
