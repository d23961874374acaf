"""Readers of TRC, MOT, C3D and BVH, written from the formats' descriptions and not from the code that writes them."""
import struct
from pathlib import Path

import numpy as np


def read_trc(file):
    """{"rate", "units", "names", "frame", "time", "points" (frames, markers, 3)}; checked like OpenSim's adapter."""
    lines = Path(file).read_text().split("\n")
    assert lines[0].split("\t")[0] == "PathFileType"
    keys, values = lines[1].split("\t"), lines[2].split("\t")
    assert keys == [
        "DataRate",
        "CameraRate",
        "NumFrames",
        "NumMarkers",
        "Units",
        "OrigDataRate",
        "OrigDataStartFrame",
        "OrigNumFrames",
    ], keys
    header = dict(zip(keys, values))
    names = [n for n in lines[3].split("\t") if n]
    assert names[:2] == ["Frame#", "Time"]
    names = names[2:]
    assert len(names) == int(header["NumMarkers"])
    axes = [a for a in lines[4].split("\t") if a]
    assert axes == [f"{a}{n + 1}" for n in range(len(names)) for a in "XYZ"]
    assert lines[5] == ""
    rows = [line.split("\t") for line in lines[6:] if line]
    assert len(rows) == int(header["NumFrames"])
    assert all(len(r) == 2 + 3 * len(names) for r in rows)
    # OpenSim's TRCFileAdapter merges runs of tabs and blanks: no cell may be empty, no name contain a blank.
    assert all(len(line.split()) == 2 + 3 * len(names) for line in lines[6:] if line)
    assert lines[3].split() == ["Frame#", "Time", *names] and len(lines[2].split()) == len(keys)
    table = np.array(rows, float)
    return {
        "rate": float(header["DataRate"]),
        "units": header["Units"],
        "names": names,
        "frame": table[:, 0],
        "time": table[:, 1],
        "points": table[:, 2:].reshape(len(rows), -1, 3),
    }


def read_mot(file):
    """{"degrees", "columns": {name: values}}; header checked like OpenSim's Storage."""
    lines = Path(file).read_text().split("\n")
    end = lines.index("endheader")
    header = dict(line.split("=") for line in lines[1:end] if "=" in line)
    labels = lines[end + 1].split("\t")
    assert labels[0] == "time" and len(set(labels)) == len(labels)
    table = np.array([line.split("\t") for line in lines[end + 2 :] if line], float)
    # OpenSim's Storage and STOFileAdapter: a version, a first line that is no key, increasing times, no blank in a label.
    assert header["version"] == "1" and header["inDegrees"] in ("yes", "no") and "=" not in lines[0]
    assert lines[end + 1].split() == labels and (np.diff(table[:, 0]) > 0).all()
    assert table.shape == (int(header["nRows"]), int(header["nColumns"])) and table.shape[1] == len(labels)
    return {"degrees": header["inDegrees"] == "yes", "columns": dict(zip(labels, table.T))}


def read_c3d(file):
    """{"header", "parameters": {group: {name: value}}, "points" (frames, points, 3), "residual"}; Intel floats only."""
    data = Path(file).read_bytes()
    assert len(data) % 512 == 0
    words = struct.unpack_from("<BBHHHHHfHHf", data)
    header = dict(
        zip(
            (
                "parameter_block",
                "key",
                "points",
                "analog",
                "first",
                "last",
                "gap",
                "scale",
                "data_block",
                "analog_rate",
                "rate",
            ),
            words,
        )
    )
    assert header["key"] == 0x50
    at = 512 * (header["parameter_block"] - 1)
    _, key, blocks, processor = struct.unpack_from("BBBB", data, at)
    assert (key, processor) == (0x50, 84)
    section_end = at + 512 * blocks
    at += 4
    names, parameters = {}, {}
    while True:
        length, group = struct.unpack_from("bb", data, at)
        if length == 0:
            break
        name = data[at + 2 : at + 2 + abs(length)].decode("ascii")
        at += 2 + abs(length)
        following = at + struct.unpack_from("<H", data, at)[0]
        here = at + 2
        if group < 0:
            names[-group] = name
            parameters[name] = {}
        else:
            kind, dimensions = struct.unpack_from("bB", data, here)
            sizes = list(data[here + 2 : here + 2 + dimensions])
            here += 2 + dimensions
            count = int(np.prod(sizes)) if sizes else 1
            if kind == -1:
                text = data[here : here + count]
                value = (
                    text.decode()
                    if dimensions == 1
                    else [text[n : n + sizes[0]].decode().rstrip() for n in range(0, count, max(sizes[0], 1))]
                )
            else:
                value = np.frombuffer(data, {1: "u1", 2: "<u2", 4: "<f4"}[kind], count, here)
                value = value[0] if dimensions == 0 else value
            here += abs(kind) * count
            parameters[names[group]][name] = value
        described = data[here]
        assert here + 1 + described == following, name
        at = following
    assert at < section_end <= 512 * (header["data_block"] - 1)
    point = parameters["POINT"]
    assert point["SCALE"] < 0 and point["DATA_START"] == header["data_block"] and point["USED"] == header["points"]
    frames = header["last"] - header["first"] + 1
    raw = np.frombuffer(data, "<f4", 4 * frames * header["points"], 512 * (header["data_block"] - 1))
    raw = raw.reshape(frames, header["points"], 4)
    # The fourth float is an integer of two bytes: cameras above, residual below; negative for an invalid point.
    points = np.where(raw[..., 3:] < 0, np.nan, raw[..., :3].astype(float))
    return {"header": header, "parameters": parameters, "points": points, "residual": raw[..., 3]}


def rotation(axis, degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array(
        {
            "X": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "Y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "Z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[axis]
    )


class Bvh:
    """Joints by name, ends as NAME_end; positions() does the forward kinematics."""

    def __init__(self, file):
        words = Path(file).read_text().split()
        assert words[0] == "HIERARCHY"
        self.names, self.parents, self.offsets, self.channels = [], [], [], []
        stack, at = [], 1
        while words[at] != "MOTION":
            word = words[at]
            if word in ("ROOT", "JOINT", "End"):
                name = self.names[stack[-1]] + "_end" if word == "End" else words[at + 1]
                assert words[at + 2] == "{"
                self.names.append(name)
                self.parents.append(stack[-1] if stack else -1)
                self.offsets.append(None)
                self.channels.append([])
                stack.append(len(self.names) - 1)
                at += 3
            elif word == "OFFSET":
                self.offsets[stack[-1]] = np.array(words[at + 1 : at + 4], float)
                at += 4
            elif word == "CHANNELS":
                count = int(words[at + 1])
                self.channels[stack[-1]] = words[at + 2 : at + 2 + count]
                at += 2 + count
            else:
                assert word == "}", word
                stack.pop()
                at += 1
        assert not stack and words[at + 1] == "Frames:" and words[at + 3 : at + 5] == ["Frame", "Time:"]
        self.frame_time = float(words[at + 5])
        self.motion = np.array(words[at + 6 :], float).reshape(int(words[at + 2]), -1)
        assert self.motion.shape[1] == sum(map(len, self.channels))

    def positions(self, frame):
        values = iter(self.motion[frame])
        world, out = [], {}
        for name, parent, offset, channels in zip(self.names, self.parents, self.offsets, self.channels):
            matrix, position = np.eye(3), offset.copy()
            for channel in channels:
                value = next(values)
                if channel.endswith("position"):
                    position["XYZ".index(channel[0])] += value
                else:
                    matrix = matrix @ rotation(channel[0], value)
            if parent >= 0:
                before, origin = world[parent]
                matrix, position = before @ matrix, origin + before @ position
            world.append((matrix, position))
            out[name] = position
        return out
