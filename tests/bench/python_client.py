#!/usr/bin/python3
"""Measures how many poses per second the Python client reads without loss, and the time to decode a volume.

usage: python_client.py [--build build/release] [--seconds 10] [--results FOLDER]

The pipeline measures far fewer poses per second than the client can read, so a server in this script sends poses of
the virtual studio's daemon, renumbered, at a given rate and with the daemon's limit for slow readers: the stream ends
when more than 256 messages wait. The client reads joints, angles, coordinates and header of each message and counts
the missing ones. The second part reads from the daemon itself as fast as it can. Bound: 1000 poses per second without
loss. Writes python_client.md."""
import argparse
import asyncio
import os
import subprocess
import sys
import tempfile
import time
from concurrent import futures
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
RATE, QUEUE = 1000, 256


def serve(build, file):
    """Sends the poses in `file` in a loop, max_rate_hz per second; 0: as fast as possible."""
    sys.path.insert(0, str(build / "client/python"))
    import grpc
    from kinevox.v1 import stream_service_pb2 as pb

    kept = []
    data = Path(file).read_bytes()
    while data:
        size = int.from_bytes(data[:4], "little")
        subjects = pb.StreamPosesResponse.FromString(data[4 : 4 + size]).subjects
        kept.append(pb.StreamPosesResponse(subjects=subjects).SerializeToString())
        data = data[4 + size :]

    def stream(request, context):
        begin, sent = time.time_ns(), 0
        while context.is_active():
            if request.max_rate_hz:
                due = int((time.time_ns() - begin) * 1e-9 * request.max_rate_hz)
                if due - sent > QUEUE:
                    context.abort(grpc.StatusCode.RESOURCE_EXHAUSTED, "this daemon's queue is full; read faster")
                if due <= sent:
                    time.sleep(0.0005)
                    continue
            # Concatenated protobuf messages merge.
            header = pb.StreamPosesResponse()
            header.header.sequence, header.header.capture_time_ns = sent, time.time_ns()
            yield header.SerializeToString() + kept[sent % len(kept)]
            sent += 1

    server = grpc.server(futures.ThreadPoolExecutor(2))
    server.add_generic_rpc_handlers(
        (
            grpc.method_handlers_generic_handler(
                "kinevox.v1.StreamService",
                {"StreamPoses": grpc.unary_stream_rpc_method_handler(stream, pb.StreamPosesRequest.FromString, None)},
            ),
        )
    )
    print(server.add_insecure_port("127.0.0.1:0"), flush=True)
    server.start()
    server.wait_for_termination()


def look(pose):
    """Reads every kind of value."""
    return (
        pose.coordinates.deg[0]
        + pose.angles.deg[0]
        + pose.joints.positions_m[0, 0]
        + pose.angles.velocity_deg_per_s[0]
        + pose.header.capture_time_ns
    )


class Count:
    """Statistics of the received poses."""

    def __init__(self, look_at_all):
        self.look_at_all, self.poses, self.gaps, self.missed, self.last = look_at_all, 0, 0, 0, None
        self.gave_up = False  # the server ended the stream: too slow
        self.late_ms, self.begin, self.cpu = [], None, 0.0

    def take(self, pose):
        if self.begin is None:
            self.begin, self.cpu = time.monotonic(), time.process_time()
        if self.look_at_all:
            look(pose)
        self.poses += 1
        self.missed += pose.missed_count
        if self.last is not None and pose.sequence > self.last:
            self.gaps += pose.sequence - self.last - 1
        self.last = pose.sequence
        self.late_ms.append((time.time_ns() - pose.capture_time_ns) * 1e-6)
        self.end, self.cpu_end = time.monotonic(), time.process_time()

    def row(self, what):
        seconds = self.end - self.begin
        cpu_us = (self.cpu_end - self.cpu) / self.poses * 1e6
        late = np.percentile(self.late_ms, [50, 99])
        lost = "too slow" if self.gave_up else f"{self.gaps + self.missed}"
        return [
            what,
            f"{self.poses}",
            f"{self.poses / seconds:.0f}",
            lost,
            f"{late[0]:.1f}",
            f"{late[1]:.1f}",
            f"{cpu_us:.0f}",
        ]


def blocking(address, seconds, rate, look_at_all=True):
    from kinevox import Client, ResourceExhausted

    count = Count(look_at_all)
    with Client(address) as client, client.poses(max_rate_hz=rate) as poses:
        try:
            for pose in poses:
                count.take(pose)
                if time.monotonic() - count.begin > seconds:
                    break
        except ResourceExhausted:
            count.gave_up = True
    return count


async def asynchronous(address, seconds, rate):
    from kinevox import AsyncClient, ResourceExhausted

    count = Count(True)
    async with AsyncClient(address) as client, client.poses(max_rate_hz=rate) as poses:
        try:
            async for pose in poses:
                count.take(pose)
                if time.monotonic() - count.begin > seconds:
                    break
        except ResourceExhausted:
            count.gave_up = True
    return count


def table(head, rows):
    lines = ["| " + " | ".join(head) + " |", "| --- " + "| ---: " * (len(head) - 1) + "|"]
    return "\n".join(lines + ["| " + " | ".join(row) + " |" for row in rows]) + "\n"


def from_the_daemon(build, folder, seconds):
    """Poses and volumes as bytes, and a row of the daemon as fast as it can."""
    from kinevox import Client
    from studio_daemon import StudioDaemon

    daemon = StudioDaemon(str(build / "server/daemon/kinevoxd"), folder, size=(640, 480), fps=1000)
    try:
        with Client(daemon.address) as client:
            with client.poses(idle_timeout_s=60) as poses:
                next(pose for pose in poses if pose.found)
                kept = [pose.message.SerializeToString() for pose, _ in zip(poses, range(50)) if pose.found]
            # The stream keeps its results, so the volumes are decoded once more.
            from kinevox import requests
            from kinevox.streams import Stream

            call = requests.volumes("latest", 0, None, None, True)
            bare = type(call)(
                call.method,
                call.request,
                call.response,
                lambda message, _: message.subjects[0].encoded_volume if message.subjects else b"",
            )
            raw = Stream(client._transport, bare)
            volumes = [volume for volume, _ in zip(raw, range(20)) if volume]
            raw.close()
            lost = client.status().lost_frame_set_count
            count = Count(True)
            with client.poses(idle_timeout_s=60) as poses:
                for pose in poses:
                    count.take(pose)
                    if time.monotonic() - count.begin > seconds:
                        break
            lost = client.status().lost_frame_set_count - lost
        return kept, volumes, count, lost
    finally:
        daemon.stop()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--build", type=Path, default=REPOSITORY / "build/release")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--results", type=Path, default=REPOSITORY / "tests/bench/results")
    parser.add_argument("--serve", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        return serve(options.build, options.serve)
    sys.path[:0] = [str(options.build / "client/python"), str(REPOSITORY / "tests/support")]
    from kinevox import Volume

    with tempfile.TemporaryDirectory() as folder:
        kept, volumes, count, lost = from_the_daemon(options.build, folder, options.seconds)
        file = Path(folder) / "poses"
        file.write_bytes(b"".join(len(message).to_bytes(4, "little") + message for message in kept))
        load = os.getloadavg()[0]
        server = subprocess.Popen(
            [sys.executable, __file__, "--build", str(options.build), "--serve", str(file)],
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            address = f"127.0.0.1:{int(server.stdout.readline())}"
            paced = [
                blocking(address, options.seconds, RATE),
                asyncio.run(asynchronous(address, options.seconds, RATE)),
            ]
            rows = [
                paced[0].row(f"{RATE} per second, every value read"),
                paced[1].row("the same, asyncio"),
                blocking(address, options.seconds, 0).row("as fast as possible, every value read"),
                blocking(address, options.seconds, 0, False).row("as fast as possible, the sequence only"),
                asyncio.run(asynchronous(address, options.seconds, 0)).row(
                    "as fast as possible, every value read, asyncio"
                ),
            ]
        finally:
            server.terminate()
            server.wait()
    times = []
    for volume in volumes:
        begin = time.perf_counter()
        decoded = Volume(volume)
        times.append((time.perf_counter() - begin) * 1000)
    head = [
        "poses from this script's server",
        "poses",
        "per second",
        "lost",
        "latency, ms: median",
        "99th percentile",
        "CPU per pose, us",
    ]
    text = (
        f"# The Python client\n\n`tests/bench/python_client.py`, {os.cpu_count()} cores, {options.seconds:g} s each, load average "
        f"{load:.1f} at the start, poses of "
        f"{np.mean([len(message) for message in kept]):.0f} bytes. Bound: {RATE} poses per second without loss. The latency is "
        "from the server's sending until the client has read every value; as fast as possible, it includes the time in gRPC's "
        f"buffers.\n\n{table(head, rows)}\n"
        f"The daemon on the virtual studio, 4 x 640 x 480, at a higher frame rate than it can measure: {count.poses} poses, "
        f"{count.row('')[2]} per second, {count.missed} missed by the stream, {count.gaps} gaps in the sequence "
        f"({lost} frame sets lost before the pipeline, by the daemon's count).\n\n"
        f"A volume of {decoded.volume_litres:.0f} litres at {1000 * decoded.voxel_m:.0f} mm, {len(decoded.colours)} coloured surface "
        f"voxels, {len(volumes[-1]) / 1000:.0f} kB: decoded in {np.median(times):.1f} ms (median of {len(times)}).\n"
    )
    options.results.mkdir(parents=True, exist_ok=True)
    (options.results / "python_client.md").write_text(text)
    print(text, end="")
    held = (
        all(not c.gave_up and c.gaps + c.missed == 0 and c.poses >= 0.98 * RATE * options.seconds for c in paced)
        and count.missed == 0
    )
    return 0 if held else 1


if __name__ == "__main__":
    sys.exit(main())
