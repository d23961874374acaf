"""Sessions, calibrations and ground truth, read for the accuracy scripts (Debian's numpy and cv2 suffice)."""
import csv
import gzip
import os
import sys
import zipfile
from pathlib import Path

import cv2
import numpy as np

try:
    import tomllib
except ModuleNotFoundError:  # Python < 3.11
    import tomli as tomllib

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "server/tools/report"))
from kinevox_report.body_table import BONES, GEOMETRIC_ANGLE_NAMES, JOINT_NAMES  # noqa: E402, F401

# The shared truth tables were rendered before geometric angles had names of their own: knee_flexion_l_deg.
TRUTH_NAMES = {f"{name.replace('_geometric', '')}_deg": f"{name}_deg" for name in GEOMETRIC_ANGLE_NAMES}


def data_folder():
    """The shared test data: $KINEVOX_TEST_DATA, else ../shared/data next to the repository."""
    return Path(os.environ.get("KINEVOX_TEST_DATA", REPOSITORY.parent / "shared" / "data"))


def process_program():
    """kinevox-process: $KINEVOX_PROCESS, else the latest one in the build folders."""
    if "KINEVOX_PROCESS" in os.environ:
        return Path(os.environ["KINEVOX_PROCESS"])
    found = [p for p in REPOSITORY.glob("build*/**/kinevox-process") if p.is_file()]
    if not found:
        raise SystemExit("kinevox-process is not built; build it, or set KINEVOX_PROCESS")
    return max(found, key=lambda p: p.stat().st_mtime)


class Camera:
    def __init__(self, section):
        self.name = section["name"]
        self.width, self.height = (int(v) for v in section["size"])
        self.matrix = np.array(section["matrix"], float)
        self.distortion = np.array(section["distortions"], float)
        self.translation = np.array(section["translation"], float)
        self.rotation = cv2.Rodrigues(np.array(section["rotation"], float))[0]

    def project(self, points):
        """World points (n, 3) in metres -> pixels (n, 2); NaN behind the camera."""
        # Not cv2.projectPoints: from Python it computes all derivatives too, ten times the work.
        k1, k2, p1, p2, k3 = np.append(self.distortion, np.zeros(5 - len(self.distortion)))
        x, y, z = self.rotation @ np.asarray(points, float).reshape(-1, 3).T + self.translation[:, None]
        z[z <= 0] = np.nan
        x /= z
        y /= z
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        pixels = np.stack(
            [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y],
            1,
        )
        return pixels * self.matrix[[0, 1], [0, 1]] + self.matrix[:2, 2]


CARVED_AT_ONCE = 32768  # points, so that temporary arrays stay in the cache


def carve(cameras, masks, points):
    """Indices of the points (n, 3) whose pixel is in the mask of every camera that sees them, and how many see each."""
    kept, views = [], []
    for first in range(0, len(points), CARVED_AT_ONCE):
        indices = np.arange(first, min(first + CARVED_AT_ONCE, len(points)))
        seen_by = np.zeros(len(indices), int)
        for camera, mask in zip(cameras, masks):
            x, y = np.nan_to_num(np.floor(camera.project(points[indices]) + 0.5), nan=-1).T
            seen = (x >= 0) & (y >= 0) & (x < camera.width) & (y < camera.height)
            keep = ~seen
            keep[seen] = mask[y[seen].astype(int), x[seen].astype(int)]
            indices, seen_by = indices[keep], seen_by[keep] + seen[keep]
            if len(indices) == 0:
                break
        kept.append(indices)
        views.append(seen_by)
    return np.concatenate(kept), np.concatenate(views)


class Session:
    def __init__(self, file):
        self.file = Path(file)
        with open(self.file, "rb") as f:
            data = tomllib.load(f)
        self.name, self.fps = data["name"], float(data["fps"])
        with open(self.file.parent / data["calibration"], "rb") as f:
            calibration = tomllib.load(f)
        self.cameras = [Camera(dict(calibration[c["name"]], name=c["name"])) for c in data["camera"]]
        self.videos = [self.file.parent / c["video"] for c in data["camera"]]
        self.truth = self.file.parent / "truth"

    def true_masks(self, camera, person=None):
        """Yields the exact silhouettes (bool, height x width) frame by frame; of one of several people the visible part."""
        name = f"{person}_{camera.name}" if person else camera.name
        if (folder := self.truth / f"masks_{name}").is_dir():
            for file in sorted(folder.glob("*.png")):
                yield cv2.imread(str(file), cv2.IMREAD_GRAYSCALE) > 127
            return
        with zipfile.ZipFile(self.truth / f"masks_{name}.zip") as archive:
            for name in sorted(n for n in archive.namelist() if n.endswith(".png")):
                yield cv2.imdecode(np.frombuffer(archive.read(name), np.uint8), cv2.IMREAD_GRAYSCALE) > 127

    def true_meshes(self):
        """Yields (frame, vertices (n, 3) in metres, triangles (m, 3))."""
        for file in sorted((self.truth / "mesh").glob("frame_*.ply.gz")):
            yield (int(file.name[6:10]), *read_mesh(file))


def read_mesh(file):
    """A binary little-endian PLY of float vertices and triangles."""
    with gzip.open(file) if str(file).endswith(".gz") else open(file, "rb") as f:
        data = f.read()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    header = data[:end].decode().splitlines()
    counts = {line.split()[1]: int(line.split()[2]) for line in header if line.startswith("element")}
    properties, element = {"vertex": [], "face": []}, None
    for line in header:
        words = line.split()
        if words[0] == "element":
            element = words[1]
        elif words[0] == "property" and element == "vertex":
            properties["vertex"].append((words[2], {"float": "<f4", "double": "<f8", "uchar": "u1"}[words[1]]))
        elif words[0] == "property" and element == "face":
            properties["face"] = words
    vertices = np.frombuffer(data, np.dtype(properties["vertex"]), counts["vertex"], end)
    end += vertices.nbytes
    index = {"int": "<i4", "uint": "<u4", "int32": "<i4", "uint32": "<u4"}[properties["face"][3]]
    faces = np.frombuffer(data, np.dtype([("n", "u1"), ("v", index, 3)]), counts["face"], end)
    return np.stack([vertices[c] for c in "xyz"], 1).astype(float), faces["v"].astype(int)


def mesh_centre(vertices, triangles):
    """Centre of gravity of a closed mesh's inside and its volume (m3)."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    sixth = np.einsum("ij,ij->i", a, np.cross(b, c)) / 6
    return ((a + b + c) / 4 * sixth[:, None]).sum(0) / sixth.sum(), abs(sixth.sum())


def read_table(file):
    """A CSV as {column: array}; empty cells are NaN. Angles of rendered truth get the names of angles.csv."""
    with open(file, newline="") as f:
        rows = list(csv.DictReader(f))
    columns = list(rows[0].keys()) if rows else []
    number = lambda text: float(text) if text else np.nan
    is_truth = Path(file).name == "angles.csv" and not any("_geometric" in c for c in columns)
    return {TRUTH_NAMES.get(c, c) if is_truth else c: np.array([number(r[c]) for r in rows]) for c in columns}
