#!/usr/bin/env python3
"""Learns the weights of the shadow rule (kernels/shared/kde_shadow.h) from sequences with exact silhouettes.

usage: shadow_rule.py --shadow-features PROGRAM SESSION_FOLDER ... [--sweep FOLDER ...] [--held-out FOLDER ...]
                      [--real SESSION_FOLDER --real-results FOLDER [--write]] [--faint]

Each folder holds session.toml and truth/masks_CAMERA.zip. Prints, per sequence, the pixels that are decided wrongly as a
fraction of the subject's area: inside and outside the subject, away from its border and near it. --sweep: trials of
sweep.py, clothes near the background's colours among them, which count less each. --held-out sequences are reported, not
learned from. --real: a real recording, whose pixels away from its silhouettes are background; --real-results: these
silhouettes, the output of `kinevox process --save silhouettes`. Its reflections are what the rule for lighter pixels is
learned from. --faint: the rule of SegmentationOptions::judge_faint, which learns from all background of the real
recording. --write replaces kernels/shared/shadow_weights.h or faint_weights.h; it needs the real recording."""
import argparse
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import cv2
import numpy as np
from scipy.optimize import minimize

WEIGHTS = Path(__file__).resolve().parents[2] / "kernels" / "shared"
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
FAINT_SWEEP_STEP = 6  # faint blocks have several times as many doubtful pixels
MAX_PIXELS = 25_000  # per sequence
# A missed limb costs more than a wider outline: the hull loses what one camera misses.
SUBJECT_WEIGHT = 1.3
SWEEP_WEIGHT = 0.5
# The rule for faint blocks is asked where the other one loses limbs, so misses cost more. It sees the contour, too:
# background there becomes a wider outline.
FAINT_SUBJECT_WEIGHT, FAINT_BORDER_WEIGHT = 4.0, 8.0
REAL_WEIGHT = 0.1
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
LIGHTER_BACKGROUND_WEIGHT, FAINT_LIGHTER_BACKGROUND_WEIGHT = 2.0, 0.25
REAL_MARGIN_PX = 15


class Pixels:
    """Features, truth, border flags and evidence (n,) of a sequence's doubtful pixels, a part of them if there are many;
    `area`: of the subject, px, for the same part; `lighter`: features (n, LIGHTER) of the subject's lighter pixels."""

    def __init__(self, name, weight, records, truth, border, area):
        self.name, self.weight = name, weight
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


def learn(sequences, subject_weight, border_weight):
    """Weights of own_terms() and, given these, of vote_terms(): the votes decide only where they may, see is_limb() of
    kde_shadow.h, so the rule must be right without them."""
    features = np.concatenate([s.features for s in sequences])
    truth = np.concatenate([s.truth for s in sequences])
    border = np.concatenate([s.border for s in sequences])
    importance = np.concatenate([np.full(len(s.truth), s.weight / s.area) for s in sequences])
    importance *= np.where(truth, subject_weight, np.where(border, border_weight, 1.0))
    blind = features.copy()
    blind[np.random.default_rng(1).random(len(blind)) < BLIND_FRACTION, FLOOR] = 0
    own = regress(own_terms(blind), truth, importance)
    limited = np.clip(own_terms(features) @ own, -MAX_LOG_ODDS / GAIN, MAX_LOG_ODDS / GAIN)
    return own, regress(vote_terms(features), truth, importance, limited)


def real_background(records, folder, results):
    """The records away from the silhouettes in `results`, and the silhouettes' area, px."""
    away, area = np.zeros(len(records), bool), 0
    for camera, images in enumerate(sorted((results / "silhouettes").glob("*/"))):
        for frame in np.unique(records["frame"]):
            rows = np.nonzero((records["camera"] == camera) & (records["frame"] == frame))[0]
            mask = cv2.imread(str(images / f"{frame:06d}.png"), cv2.IMREAD_GRAYSCALE)
            area += np.count_nonzero(mask)
            near = cv2.dilate(mask, np.ones((REAL_MARGIN_PX, REAL_MARGIN_PX)))
            away[rows] = near[records["y"][rows], records["x"][rows]] == 0
    if not away.any():
        command = f"kinevox process {folder / 'session.toml'} --out {results} --save silhouettes"
        sys.exit(f"{results}: no silhouettes beside doubtful pixels; run {command}")
    return records[away], area


def learn_lighter(subject, background, background_weight):
    """Weights of LIGHTER; the two classes weigh 1 and `background_weight` together."""
    x = np.concatenate([subject, background]).astype(np.float64)
    truth = np.arange(len(x)) < len(subject)
    importance = np.where(truth, 1 / len(subject), background_weight / len(background))
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


def parts(weights, lighter):
    """The arrays of ShadowRule, as text."""
    own, votes = (GAIN * w for w in weights)
    extra = FEATURES - OWN
    return [
        rows(values)
        for values in (
            np.concatenate([own[:OWN], votes[:extra]]),
            own[OWN:],
            votes[extra : extra + len(BASES)],
            votes[extra + len(BASES) :],
            lighter,
        )
    ]


def shadow_header(weights, lighter):
    of_features, products, vote_products, positive_vote_products, of_lighter = parts(weights, lighter)
    return f"""// Written by tests/accuracy/shadow_rule.py; features, bases and their order are those of kde_shadow.h.
#pragma once

namespace kinevox::kernels::kde {{

inline constexpr int kOwnShadowFeatures = {OWN}, kShadowFeatures = {FEATURES}, kShadowBases = {len(BASES)};
inline constexpr int kLighterFeatures = {len(LIGHTER)};

// Handed to kernels by value.
struct ShadowRule {{
    float weights[kShadowFeatures] = {{
        {of_features}}};
    // Of the products of the bases i <= j, row by row.
    float products[kShadowBases * (kShadowBases + 1) / 2] = {{
        {products}}};
    // Of the products of the bases and the votes' support, all and the positive part of it.
    float vote_products[kShadowBases] = {{
        {vote_products}}};
    float positive_vote_products[kShadowBases] = {{
        {positive_vote_products}}};
    // Of a lighter pixel's features {", ".join(str(i) for i in LIGHTER)}.
    float lighter[kLighterFeatures] = {{
        {of_lighter}}};
}};

}}  // namespace kinevox::kernels::kde
"""


def faint_header(weights, lighter):
    arrays = ",\n    ".join("{" + text + "}" for text in parts(weights, lighter))
    return f"""// Written by tests/accuracy/shadow_rule.py --faint; features, bases and their order are those of kde_shadow.h.
#pragma once

#include "kernels/shared/shadow_weights.h"

namespace kinevox::kernels::kde {{

// With SegmentationOptions::judge_faint.
inline constexpr ShadowRule kFaintRule{{
    {arrays}}};

}}  // namespace kinevox::kernels::kde
"""


class Reader:
    """Reads sequences' features, which the program writes."""

    def __init__(self, program, work, faint):
        self.program, self.work, self.faint = program, work, faint

    def records(self, folder, step):
        file = self.work / ("_".join(folder.resolve().parts[-3:]) + ".bin")
        if not file.exists():
            command = [self.program, folder / "session.toml", file, str(step)] + ["faint"] * self.faint
            done = subprocess.run(command, stderr=subprocess.PIPE, text=True)
            if done.returncode != 0:
                file.unlink(missing_ok=True)
                sys.exit(f"shadow_features {folder}: {done.stderr.strip()}")
        return np.fromfile(file, RECORD)

    def sequence(self, folder, weight, step):
        """A rendered sequence; its truth are the masks in truth/masks_CAMERA.zip."""
        records = self.records(folder, step)
        truth, border = np.zeros(len(records), bool), np.zeros(len(records), bool)
        area = 0
        for camera, path in enumerate(sorted((folder / "truth").glob("masks_cam*.zip"))):
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
        return Pixels(folder.name, weight, records, truth, border, area)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--shadow-features", required=True, help="the program shadow_features")
    parser.add_argument("folders", nargs="+", type=Path, help="sequences to learn from")
    parser.add_argument("--sweep", nargs="*", type=Path, default=[], help="trials of sweep.py to learn from")
    parser.add_argument("--held-out", nargs="*", type=Path, default=[], help="sequences that are only reported")
    parser.add_argument("--real", type=Path, help="real recording to learn background from")
    parser.add_argument("--real-results", type=Path, help="its results with silhouettes")
    parser.add_argument("--faint", action="store_true", help="learn the rule that judges faint blocks, too")
    parser.add_argument("--work", type=Path, help="keep the features in this folder")
    parser.add_argument("--write", action="store_true", help="replace the weights in kernels/shared")
    arguments = parser.parse_args()
    if (arguments.real is None) != (arguments.real_results is None):
        parser.error("--real and --real-results go together; give both or neither")
    if arguments.write and not arguments.real:
        parser.error("--write needs --real and --real-results for the weights of lighter pixels")
    with tempfile.TemporaryDirectory() as scratch:
        work = arguments.work or Path(scratch)
        work.mkdir(parents=True, exist_ok=True)
        reader = Reader(arguments.shadow_features, work, arguments.faint)
        sweep_step = FAINT_SWEEP_STEP if arguments.faint else SWEEP_STEP
        learned = [reader.sequence(f, 1.0, STEP) for f in arguments.folders]
        learned += [reader.sequence(f, SWEEP_WEIGHT, sweep_step) for f in arguments.sweep]
        held_out = [reader.sequence(f, 0.0, sweep_step) for f in arguments.held_out]
        if arguments.real:
            records, area = real_background(
                reader.records(arguments.real, STEP), arguments.real, arguments.real_results
            )
            reflections = records["features"][records["features"][:, BRIGHT] > 0][:, LIGHTER]
            weight = FAINT_LIGHTER_BACKGROUND_WEIGHT if arguments.faint else LIGHTER_BACKGROUND_WEIGHT
            lighter = learn_lighter(np.concatenate([s.lighter for s in learned]), reflections, weight)
            none = np.zeros(len(records), bool)
            real = Pixels(arguments.real.name, REAL_WEIGHT, records, none, none, area)
            (learned if arguments.faint else held_out).append(real)
    if arguments.faint:
        weights = learn(learned, FAINT_SUBJECT_WEIGHT, FAINT_BORDER_WEIGHT)
    else:
        weights = learn(learned, SUBJECT_WEIGHT, 1.0)
    print("fractions of the subject's area: missed added, then the same within 2 px of the border")
    for title, group in (("learned from", learned), ("held out", held_out)):
        for sequence in group:
            print(f"{title:12s} {sequence.text(weights)}")
    if arguments.write and arguments.faint:
        (WEIGHTS / "faint_weights.h").write_text(faint_header(weights, lighter))
    elif arguments.write:
        (WEIGHTS / "shadow_weights.h").write_text(shadow_header(weights, lighter))
    return 0


if __name__ == "__main__":
    sys.exit(main())
