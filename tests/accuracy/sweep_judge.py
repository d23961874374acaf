"""One trial of sweep.py against its truth: joints, stated standard deviations, silhouettes and body."""
import tomllib

import cv2
import numpy as np

from session_data import JOINT_NAMES, Session, read_table

JOINTS = list(JOINT_NAMES)
SILENT_M, SILENT_STD = 0.100, 3.0
MIN_MASK_PX = 40  # of a true silhouette that counts
LENGTHS = {
    "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"),
    "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
}


def joint_array(table, suffixes):
    return np.stack([np.stack([table[f"{j}{s}"] for s in suffixes], 1) for j in JOINTS], 1)


def by_frame(table, values, frames):
    """The first subject's values of each frame; NaN where there is none."""
    out = np.full((len(frames), *values.shape[1:]), np.nan)
    place = {int(f): i for i, f in reversed(list(enumerate(table["frame"])))}
    for i, frame in enumerate(frames):
        if int(frame) in place:
            out[i] = values[place[int(frame)]]
    return out


def poses(session, results):
    """Truth, found joints (frames, joints, 3) and stated standard deviations (frames, joints), metres."""
    truth = read_table(session.truth / "joints.csv")
    frames = truth["frame"].astype(int)
    exact = joint_array(truth, ("_x", "_y", "_z"))
    found, std = np.full_like(exact, np.nan), np.full(exact.shape[:2], np.nan)
    if (results / "joints.csv").exists():
        table, stated = read_table(results / "joints.csv"), read_table(results / "uncertainty.csv")
        if table:
            found = by_frame(table, joint_array(table, ("_x", "_y", "_z")), frames)
            std = by_frame(stated, joint_array(stated, ("_std_m",))[..., 0], frames)
    return exact, found, std


def pose_metrics(exact, found, std):
    offset = found - exact
    error = np.linalg.norm(offset, axis=2)
    known = np.isfinite(error)
    silent = known & (error > SILENT_M) & (error > SILENT_STD * std)
    ratio = (np.abs(offset) / std[..., None])[known & np.isfinite(std)]
    worst = np.argsort(-np.nan_to_num(np.where(known, error, np.nan)).mean(0))[:3]
    metrics = {
        "mean_mm": 1000 * float(error[known].mean()) if known.any() else float("nan"),
        "p95_mm": 1000 * float(np.percentile(error[known], 95)) if known.any() else float("nan"),
        "silent": float(silent.mean()),
        "withheld": float(1 - known.mean()),
        "worst_joints": [JOINTS[j] for j in worst],
        "worst_frame": int(np.argmax(np.where(known, error, 0).mean(1))),
    }
    for n in (1, 2, 3):
        metrics[f"within_{n}"] = float(np.mean(ratio < n)) if len(ratio) else float("nan")
    return metrics


def true_mask(session, camera, frame):
    return (
        cv2.imread(str(session.truth / f"masks_{camera.name}" / f"frame_{frame:04d}.png"), cv2.IMREAD_GRAYSCALE) > 127
    )


def found_mask(session, results, camera, frame):
    image = cv2.imread(str(results / "silhouettes" / camera.name / f"{frame:06d}.png"), cv2.IMREAD_GRAYSCALE)
    return image > 127 if image is not None else np.zeros((camera.height, camera.width), bool)


def silhouette_metrics(session, results, frames):
    """Mean IoU per camera over the frames in which it sees the subject."""
    cameras = {}
    for camera in session.cameras:
        values = []
        for frame in range(frames):
            truth = true_mask(session, camera, frame)
            if truth.sum() < MIN_MASK_PX:
                continue
            found = found_mask(session, results, camera, frame)
            values.append(np.count_nonzero(found & truth) / np.count_nonzero(found | truth))
        if values:
            cameras[camera.name] = float(np.mean(values))
    return cameras


def body_metrics(results, exact, stature_m):
    """Relative errors of the fitted body: stature, and the segments' lengths against those of the true joints."""
    file = results / "body.toml"
    if not file.exists():
        return {"stature": float("nan"), "lengths": {}}
    body = tomllib.loads(file.read_text(encoding="utf-8"))
    lengths = {}
    for name, (upper, lower) in LENGTHS.items():
        ends = [[JOINTS.index(f"{joint}_{side}") for joint in (upper, lower)] for side in "lr"]
        true = np.mean([np.linalg.norm(exact[:, a] - exact[:, b], axis=1).mean() for a, b in ends])
        lengths[name] = float(body[f"{name}_m"] / true - 1)
    return {"stature": float(body["stature_m"] / stature_m - 1), "lengths": lengths}


def judge(session_file, results, scene):
    """All metrics of a trial; fractions, millimetres."""
    session = Session(session_file)
    exact, found, std = poses(session, results)
    metrics = pose_metrics(exact, found, std)
    metrics["cameras_iou"] = silhouette_metrics(session, results, len(exact))
    metrics |= body_metrics(results, exact, scene["subject"]["stature_m"])
    return metrics
