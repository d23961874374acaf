#!/usr/bin/env python3
"""Learns the weights of the shadow rule (kernels/shared/kde_shadow.h) from sequences with exact silhouettes.

usage: shadow_rule.py --shadow-features PROGRAM SESSION_FOLDER ... [--sweep FOLDER ...] [--held-out FOLDER ...]
                      [--lighter SESSION_FOLDER --lighter-results FOLDER [--write]]

Each folder holds session.toml and truth/masks_CAMERA.zip. Prints, per sequence, the pixels that are decided wrongly as a
fraction of the subject's area: inside and outside the subject, away from its border and near it. --sweep: trials of
sweep.py, clothes near the background's colours among them, which count less each. --held-out sequences are reported, not
learned from. --lighter: a real recording in which reflections lighten the background; --lighter-results: its output of
`kinevox process --save silhouettes`, lighter pixels away from these silhouettes are background. --write replaces
kernels/shared/shadow_weights.h; it needs both."""
import argparse
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import minimize

WEIGHTS = Path(__file__).resolve().parents[2] / "kernels" / "shared" / "shadow_weights.h"
FEATURES = 27
RECORD = np.dtype(
    [
        ("frame", "<i2"),
        ("camera", "<i2"),
        ("x", "<i2"),
        ("y", "<i2"),
        ("evidence", "<f4"),
        ("features", "<f4", FEATURES),
    ]
)
STEP, SWEEP_STEP = 6, 2  # frames
MAX_PIXELS = 25_000  # per sequence
# A missed limb costs more than a wider outline: the hull loses what one camera misses.
SUBJECT_WEIGHT = 1.3
SWEEP_WEIGHT = 0.5
# The smoothing of the evidence weighs pixels by their log odds. Decided ones must weigh as much as those that need no
# second look, or outlines move outwards.
GAIN = 4.0


# The rule without the votes of the other cameras (features OWN and more, kOwnShadowFeatures of kde_shadow.h).
OWN = 22
# Features whose products the rule weighs, too, as shadow_bases() of kde_shadow.h scales them.
BASES = ((1, 1.0), (2, 0.25), (4, 1.0), (5, 4.0), (9, 4.0), (12, 1.0), (13, 1.0), (16, 4.0), (20, 10.0), (15, 1.0))
MAX_BASE = 1.6
PAIRS = np.triu_indices(len(BASES))
SUPPORT, POSITIVE_SUPPORT = 23, 24
MAX_LOG_ODDS = 8.0


def scaled_bases(features):
    bases = np.stack([features[:, i] * np.float32(scale) for i, scale in BASES], 1)
    bases[:, 7] = np.minimum(bases[:, 7], MAX_BASE)
    return bases


def own_terms(features):
    """(n, FEATURES) -> (n, OWN + products)."""
    bases = scaled_bases(features)
    return np.concatenate([features[:, :OWN], bases[:, PAIRS[0]] * bases[:, PAIRS[1]]], 1)


def vote_terms(features):
    """(n, FEATURES) -> (n, FEATURES - OWN + 2 * bases)."""
    bases = scaled_bases(features)
    return np.concatenate(
        [features[:, OWN:], features[:, SUPPORT, None] * bases, features[:, POSITIVE_SUPPORT, None] * bases], 1
    )


def log_odds(features, weights):
    """Without and with the votes, (n,) each; `weights`: of own_terms() and vote_terms()."""
    own = np.clip(GAIN * (own_terms(features) @ weights[0]), -MAX_LOG_ODDS, MAX_LOG_ODDS)
    return own, own + GAIN * (vote_terms(features) @ weights[1])


# The features that need another camera's view of the floor, and the fraction of the pixels that are learned from without
# them: walls have no floor point, and shadows on them are rare in what the rule learns from.
FLOOR = slice(15, 22)
BLIND_FRACTION = 0.3
# Pixels that are lighter than any shadow have a rule of their own: distance from the background, colour, light, misfits of
# one light, and whether other cameras see their floor point as light as they are.
BRIGHT = 10
LIGHTER = [0, 1, 2, 4, 9, 10, 12, 13, 15, 19]
# A background that turns into the subject costs more than a missed pixel: nothing else removes it.
LIGHTER_BACKGROUND_WEIGHT = 2.0
LIGHTER_MARGIN_PX = 15


class Pixels:
    """Features, truth and border flags (n,) of a sequence's doubtful pixels; `area`: of the subject, px, scaled to the
    drawn pixels."""

    def __init__(self, folder, records, weight, step):
        self.name, self.weight = folder.name, weight
        archives = sorted((folder / "truth").glob("masks_cam*.zip"))
        truth, border = np.zeros(len(records), bool), np.zeros(len(records), bool)
        area = 0
        for camera, path in enumerate(archives):
            with zipfile.ZipFile(path) as archive:
                names = sorted(archive.namelist())
                for frame in range(0, len(names), step):
                    image = cv2.imdecode(np.frombuffer(archive.read(names[frame]), np.uint8), cv2.IMREAD_GRAYSCALE)
                    mask = (image > 0).astype(np.uint8)
                    area += int(mask.sum())
                    rows = np.nonzero((records["camera"] == camera) & (records["frame"] == frame))[0]
                    y, x = records["y"][rows], records["x"][rows]
                    inner, outer = cv2.erode(mask, np.ones((3, 3))), cv2.dilate(mask, np.ones((5, 5)))
                    truth[rows] = mask[y, x] > 0
                    border[rows] = (outer > inner)[y, x]
        lighter = records["features"][:, BRIGHT] > 0
        self.lighter = records["features"][lighter & truth][:, LIGHTER]
        ruled = ~lighter
        records, truth, border = records[ruled], truth[ruled], border[ruled]
        chosen = np.random.default_rng(0).random(len(records)) < min(1, MAX_PIXELS / max(len(records), 1))
        self.features = records["features"][chosen]
        self.truth, self.border, self.evidence = truth[chosen], border[chosen], records["evidence"][chosen]
        self.area = max(area * chosen.mean(), 1.0)

    def text(self, weights):
        def errors(subject):
            parts = []
            for where in (~self.border, self.border):
                missed = np.count_nonzero(~subject & self.truth & where) / self.area
                added = np.count_nonzero(subject & ~self.truth & where) / self.area
                parts.append(f"{missed:.4f} {added:.4f}")
            return "  ".join(parts)

        own, voted = log_odds(self.features, weights)
        return (
            f"{self.name:10s} without {errors(self.evidence > 0)}   own {errors(own > 0)}   votes {errors(voted > 0)}"
        )


def regress(x, truth, importance, offset=0.0):
    """Logistic regression on `x` in addition to `offset`, nats; x is scaled in place."""
    importance = importance / importance.sum()
    scale = np.sqrt((x * x).mean(0)) + 1e-6
    x /= scale.astype(x.dtype)
    sign = np.where(truth, 1.0, -1.0)

    def loss(b):
        z = sign * (x @ b.astype(x.dtype) + offset)
        p = 1 / (1 + np.exp(np.clip(z, -40, 40)))
        return (importance * np.logaddexp(0, -z)).sum() + 1e-6 * (b @ b), 2e-6 * b - (
            x.T @ (importance * p * sign).astype(x.dtype)
        ).astype(np.float64)

    return minimize(loss, np.zeros(x.shape[1]), jac=True, method="L-BFGS-B", options={"maxiter": 250}).x / scale


def learn(sequences):
    """Weights of own_terms() and, given these, of vote_terms(): the votes decide only where they may, see is_limb() of
    kde_shadow.h, so the rule must be right without them."""
    features = np.concatenate([s.features for s in sequences])
    truth = np.concatenate([s.truth for s in sequences])
    importance = np.concatenate([np.full(len(s.truth), s.weight / s.area) for s in sequences])
    importance *= np.where(truth, SUBJECT_WEIGHT, 1.0)
    blind = features.copy()
    blind[np.random.default_rng(1).random(len(blind)) < BLIND_FRACTION, FLOOR] = 0
    own = regress(own_terms(blind), truth, importance)
    limited = np.clip(own_terms(features) @ own, -MAX_LOG_ODDS / GAIN, MAX_LOG_ODDS / GAIN)
    return own, regress(vote_terms(features), truth, importance, limited)


def lighter_background(program, folder, results, work):
    """Features (n, LIGHTER) of the lighter pixels away from the silhouettes in `results`."""
    records = features_of(program, folder, work, STEP)
    records = records[records["features"][:, BRIGHT] > 0]
    away = np.zeros(len(records), bool)
    for camera, images in enumerate(sorted((results / "silhouettes").glob("*/"))):
        for frame in np.unique(records["frame"]):
            rows = np.nonzero((records["camera"] == camera) & (records["frame"] == frame))[0]
            mask = cv2.imread(str(images / f"{frame:06d}.png"), cv2.IMREAD_GRAYSCALE)
            near = cv2.dilate(mask, np.ones((LIGHTER_MARGIN_PX, LIGHTER_MARGIN_PX)))
            away[rows] = near[records["y"][rows], records["x"][rows]] == 0
    if not away.any():
        command = f"kinevox process {folder / 'session.toml'} --out {results} --save silhouettes"
        sys.exit(f"{results}: no silhouettes beside lighter pixels; run {command}")
    return records["features"][away][:, LIGHTER]


def learn_lighter(subject, background):
    """Weights of LIGHTER; the two classes weigh 1 and LIGHTER_BACKGROUND_WEIGHT together."""
    x = np.concatenate([subject, background]).astype(np.float64)
    truth = np.arange(len(x)) < len(subject)
    importance = np.where(truth, 1 / len(subject), LIGHTER_BACKGROUND_WEIGHT / len(background))
    weights = regress(x.copy(), truth, importance)
    decided = x @ weights > 0
    print(
        f"lighter pixels: missed {np.mean(~decided[truth]):.3f} of {len(subject)}, "
        f"added {np.mean(decided[~truth]):.3f} of {len(background)}"
    )
    return GAIN * weights


def literal(value):
    text = f"{value:.5g}"
    return text + ("f" if "." in text or "e" in text else ".0f")


def rows(weights):
    return ",\n        ".join(", ".join(literal(w) for w in weights[i : i + 6]) for i in range(0, len(weights), 6))


def header(weights, lighter):
    own, votes = (GAIN * w for w in weights)
    extra = FEATURES - OWN
    return f"""// Written by tests/accuracy/shadow_rule.py; features, bases and their order are those of kde_shadow.h.
#pragma once

namespace kinevox::kernels::kde {{

inline constexpr int kOwnShadowFeatures = {OWN}, kShadowFeatures = {FEATURES}, kShadowBases = {len(BASES)};
inline constexpr int kLighterFeatures = {len(LIGHTER)};

// Handed to kernels by value.
struct ShadowRule {{
    float weights[kShadowFeatures] = {{
        {rows(np.concatenate([own[:OWN], votes[:extra]]))}}};
    // Of the products of the bases i <= j, row by row.
    float products[kShadowBases * (kShadowBases + 1) / 2] = {{
        {rows(own[OWN:])}}};
    // Of the products of the bases and the votes' support, all and the positive part of it.
    float vote_products[kShadowBases] = {{
        {rows(votes[extra : extra + len(BASES)])}}};
    float positive_vote_products[kShadowBases] = {{
        {rows(votes[extra + len(BASES) :])}}};
    // Of a lighter pixel's features {", ".join(str(i) for i in LIGHTER)}.
    float lighter[kLighterFeatures] = {{
        {rows(lighter)}}};
}};

}}  // namespace kinevox::kernels::kde
"""


def features_of(program, folder, work, step):
    file = work / f"{folder.name}.bin"
    if not file.exists():
        done = subprocess.run([program, folder / "session.toml", file, str(step)], stderr=subprocess.PIPE, text=True)
        if done.returncode != 0:
            sys.exit(f"shadow_features {folder}: {done.stderr.strip()}")
    return np.fromfile(file, RECORD)


def read_sequence(program, folder, work, weight, step):
    return Pixels(folder, features_of(program, folder, work, step), weight, step)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shadow-features", required=True, help="the program shadow_features")
    parser.add_argument("folders", nargs="+", type=Path, help="sequences to learn from")
    parser.add_argument("--sweep", nargs="*", type=Path, default=[], help="trials of sweep.py to learn from")
    parser.add_argument("--held-out", nargs="*", type=Path, default=[], help="sequences that are only reported")
    parser.add_argument("--lighter", type=Path, help="session in which reflections lighten the background")
    parser.add_argument("--lighter-results", type=Path, help="its results with silhouettes")
    parser.add_argument("--work", type=Path, help="keep the features in this folder")
    parser.add_argument("--write", action="store_true", help="replace kernels/shared/shadow_weights.h")
    arguments = parser.parse_args()
    if (arguments.lighter is None) != (arguments.lighter_results is None):
        parser.error("--lighter and --lighter-results go together; give both or neither")
    if arguments.write and not arguments.lighter:
        parser.error("--write needs --lighter and --lighter-results for the weights of lighter pixels")
    with tempfile.TemporaryDirectory() as scratch:
        work = arguments.work or Path(scratch)
        work.mkdir(parents=True, exist_ok=True)
        program = arguments.shadow_features
        learned = [read_sequence(program, f, work, 1.0, STEP) for f in arguments.folders]
        learned += [read_sequence(program, f, work, SWEEP_WEIGHT, SWEEP_STEP) for f in arguments.sweep]
        held_out = [read_sequence(program, f, work, 0.0, SWEEP_STEP) for f in arguments.held_out]
        if arguments.lighter:
            background = lighter_background(program, arguments.lighter, arguments.lighter_results, work)
            lighter = learn_lighter(np.concatenate([s.lighter for s in learned]), background)
    weights = learn(learned)
    print("fractions of the subject's area: missed added, then the same within 2 px of the border")
    for title, group in (("learned from", learned), ("held out", held_out)):
        for sequence in group:
            print(f"{title:12s} {sequence.text(weights)}")
    if arguments.write:
        WEIGHTS.write_text(header(weights, lighter))
    return 0


if __name__ == "__main__":
    sys.exit(main())
