"""Random scenes of the virtual studio for sweep.py: a pure function of seed and trial, independent of the machine.

What people, rooms and rigs look like is drawn over the whole range that the project is made for, not around what its
sequences show. Every third trial is camouflaged: trousers like the floor, a shirt like the walls, or both."""
import colorsys
import math
import random

# Name: (radius of the space that it needs, m; longest useful trial, s; speeds).
MOTIONS = {
    "walk": (1.8, 4.0, (0.7, 1.3)),
    "run": (5.5, 3.0, (0.8, 1.15)),
    "sprint_start": (5.5, 3.0, (0.85, 1.1)),
    "squat": (1.05, 4.0, (0.6, 1.4)),
    "jumping_jack": (1.05, 3.0, (0.7, 1.2)),
    "arm_raise": (1.05, 4.0, (0.6, 1.5)),
    "stand": (1.05, 3.0, (0.6, 1.5)),
    "jump": (1.05, 3.0, (0.85, 1.15)),
    "punch": (1.05, 3.5, (0.6, 1.3)),
    "kick": (1.05, 3.5, (0.6, 1.3)),
    "get_up": (1.25, 4.5, (0.7, 1.3)),
}
LANE_MOTIONS = ("run", "sprint_start")
RATES = (10, 12.5, 15, 20, 24, 25, 25, 30, 30, 50, 60, 100)
SIZES = ((640, 480), (640, 480), (640, 480), (640, 360), (800, 600), (768, 576), (960, 540), (1280, 720))
CLOTHS = (  # hue, saturation, value of reflectance
    (0.60, 0.55, 0.12), (0.62, 0.30, 0.25), (0.0, 0.0, 0.04), (0.0, 0.0, 0.20), (0.0, 0.0, 0.65), (0.02, 0.85, 0.40),
    (0.33, 0.60, 0.18), (0.12, 0.45, 0.30), (0.08, 0.55, 0.15), (0.55, 0.65, 0.30), (0.83, 0.45, 0.25), (0.14, 0.85, 0.50),
)  # fmt: skip
SKINS = ((0.66, 0.43, 0.33), (0.60, 0.37, 0.26), (0.50, 0.29, 0.19), (0.34, 0.18, 0.11), (0.17, 0.085, 0.05))
HAIRS = ((0.025, 0.018, 0.014), (0.07, 0.035, 0.018), (0.30, 0.18, 0.07), (0.14, 0.06, 0.03), (0.25, 0.24, 0.23))
FLOORS = {
    "wood": (0.075, 0.65, 0.32),
    "concrete": (0.10, 0.06, 0.30),
    "track": (0.02, 0.8, 0.33),
    "mat": (0.58, 0.45, 0.25),
}
ROOM_HALF_M, LANE_MIDDLE = (4.35, 4.15), (5.2, 0.0)


def clipped(rng, mean, spread, low, high):
    return min(max(rng.gauss(mean, spread), low), high)


def jittered(rng, hsv, hue=0.04, saturation=0.12, value=0.35):
    h = (hsv[0] + rng.uniform(-hue, hue)) % 1
    s = min(max(hsv[1] + rng.uniform(-saturation, saturation), 0), 0.9)
    v = min(max(hsv[2] * math.exp(rng.uniform(-value, value)), 0.02), 0.75)
    return [round(c, 4) for c in colorsys.hsv_to_rgb(h, s, v)]


def like(rng, colour, low=0.5, high=1.1, on_floor=True):
    """The colour of a cloth that looks like `colour` but for its brightness: `low` to `high` times, as cameras show it."""
    # Sensor values go with the power 1 / 2.2. Light from above makes upright cloth darker than the floor, by about 0.8.
    ratio = rng.uniform(low, high) / (0.8 if on_floor else 1.0)
    cast = [rng.uniform(0.96, 1.04) for _ in range(3)]
    return [round(min(max(c * k * ratio**2.2, 0.015), 0.8), 4) for c, k in zip(colour, cast)]


def draw_subject(rng):
    female = rng.random() < 0.5
    mean, spread = (1.64, 0.068) if female else (1.77, 0.072)
    stature = rng.uniform(1.45, 2.05) if rng.random() < 0.2 else clipped(rng, mean, spread, 1.45, 2.05)
    girth = math.exp(clipped(rng, 0.02, 0.09, -0.18, 0.28))
    return {
        "stature_m": round(stature, 3),
        "femininity": round(rng.uniform(0.6, 1.0), 2) if female else 0.0,
        "girth": round(girth, 3),
        "belly": round(max(0.0, min(1.0, rng.gauss(2.5 * (girth - 1), 0.25))), 2),
        # Sitting height of the stature: standard deviation 1.4 % of it, that is 2.5 % of the legs.
        "leg_scale": round(clipped(rng, 1, 0.025, 0.93, 1.07), 3),
        "arm_scale": round(clipped(rng, 1, 0.025, 0.93, 1.07), 3),
        "shoulder_scale": round(clipped(rng, 1, 0.04, 0.9, 1.1), 3),
        "hip_scale": round(clipped(rng, 1, 0.04, 0.9, 1.1), 3),
        "long_hair": rng.random() < (0.7 if female else 0.08),
        "skin": list(rng.choice(SKINS)),
        "hair": list(rng.choice(HAIRS)),
    }


def draw_clothes(rng, room, camouflage):
    pattern = "plain" if camouflage or rng.random() < 0.5 else rng.choice(("stripes", "dots", "checks", "two_tone"))
    clothes = {
        "shirt_pattern": pattern,
        "shirt": jittered(rng, rng.choice(CLOTHS)),
        "shirt_second": jittered(rng, rng.choice(CLOTHS)),
        "trousers": jittered(rng, rng.choice(CLOTHS)),
        "shoes": jittered(rng, rng.choice(CLOTHS)),
        "shorts": rng.random() < 0.3,
        "long_sleeves": rng.random() < 0.35,
        "cloth_grain": rng.choice((0.0, 0.0, 0.3, 1.0, 1.0)),
        "looseness": round(rng.choice((0.4, 1.0, 1.0, rng.uniform(1.0, 2.6))), 2),
    }
    if camouflage in ("trousers", "both"):
        clothes |= {"trousers": like(rng, room["floor_colour"]), "shorts": rng.random() < 0.1}
    if camouflage in ("shirt", "both"):
        clothes |= {"shirt": like(rng, room["wall_colour"], 0.6, 1.1, False), "long_sleeves": rng.random() < 0.6}
    return clothes


def draw_room(rng):
    floor = rng.choice(tuple(FLOORS))
    grey = rng.random() < 0.5
    wall = (rng.random(), rng.uniform(0, 0.06) if grey else rng.uniform(0.06, 0.35), rng.uniform(0.25, 0.7))
    return {
        "floor": floor,
        "floor_colour": jittered(rng, FLOORS[floor], hue=0.5 if rng.random() < 0.3 else 0.03),
        "floor_grain": rng.choice((0.0, 0.15, 0.5, 1.0, 1.0)),
        "walls": rng.choice(("paint", "paint", "brick", "panelling")),
        "wall_colour": jittered(rng, wall, 0, 0, 0.1),
        "wall_grain": rng.choice((0.0, 0.5, 1.0)),
        "furniture": rng.random() < 0.7,
        "decals": rng.random() < 0.7,
    }


def draw_light(rng, lane):
    key, panels = rng.uniform(0.15, 0.6), rng.uniform(0.1, 0.3)
    middle = LANE_MIDDLE if lane else (0.0, 0.0)
    low = not lane and rng.random() < 0.25  # a lamp on a stand, or a window
    angle, radius = rng.uniform(0, 2 * math.pi), rng.uniform(2.2, 3.2) if low else rng.uniform(0.3, 2.4)
    height = rng.uniform(1.9, 2.7) if low else (rng.uniform(4.6, 5.8) if lane else rng.uniform(3.0, 3.7))
    warm = rng.uniform(-1, 1)
    return {
        "key_fraction": round(key, 3),
        "panels_fraction": round(panels, 3),
        "key_position_m": [
            round(middle[0] + radius * math.cos(angle), 3),
            round(middle[1] + radius * math.sin(angle), 3),
            round(height, 3),
        ],
        "key_half_m": round(math.exp(rng.uniform(math.log(0.04), math.log(0.25 if low else 0.6))), 3),
        "tint": [round(1 + 0.10 * warm, 3), 0.96, round(1 - 0.14 * warm, 3)],
        "exposure": round(rng.uniform(0.5, 1.15), 3),
        "flicker": round(rng.choice((0.0, rng.uniform(0, 0.03))), 4),
    }


def place(rng, lane, angle, near):
    """A camera's position in the room, looking from `angle`."""
    if lane:
        part = rng.uniform(0.85, 1.0)
        position = (LANE_MIDDLE[0] + 10.2 * part * math.cos(angle), 8.2 * part * math.sin(angle))
        return [round(position[0], 3), round(position[1], 3), round(rng.uniform(1.2, 3.5), 3)]
    distance = rng.uniform(near, 4.4)
    x, y = distance * math.cos(angle), distance * math.sin(angle)
    shrink = min(1.0, ROOM_HALF_M[0] / max(abs(x), 1e-9), ROOM_HALF_M[1] / max(abs(y), 1e-9))
    return [round(shrink * x, 3), round(shrink * y, 3), round(rng.uniform(0.8, 3.1), 3)]


def draw_cameras(rng, motion, count=None, size=None):
    lane, radius = motion in LANE_MOTIONS, MOTIONS[motion][0]
    count = count or rng.choices((3, 4, 5, 6, 7, 8), (15, 35, 20, 15, 5, 10))[0]
    span = 2 * math.pi if count < 4 or rng.random() < 0.75 else rng.uniform(1.1, 1.6) * math.pi
    start = rng.uniform(0, 2 * math.pi)
    alike, portrait = rng.random() < 0.7, not lane and rng.random() < 0.08
    common, k1 = size or rng.choice(SIZES), rng.uniform(-0.22, 0.08) if rng.random() < 0.6 else 0.0
    cameras = []
    for i in range(count):
        angle = start + span * (i + rng.uniform(-0.28, 0.28)) / (count if span > 6 else count - 1)
        wanted = common if alike or size else rng.choice(SIZES)
        k = k1 + rng.uniform(-0.01, 0.01)
        cameras.append(
            {
                "position_m": place(rng, lane, angle, max(2.4, radius + 1.1)),
                "size_px": list(wanted),
                "zoom": round(rng.uniform(0.85, 1.05) if lane or radius > 1.5 else rng.uniform(0.85, 1.3), 3),
                "roll_deg": round((90 if portrait else 0) + rng.gauss(0, 2.0), 2),
                "aim_offset_m": [round(rng.gauss(0, 0.12), 3) for _ in range(3)],
                "distortion": [round(v, 5) for v in (k, -0.25 * k, rng.gauss(0, 4e-4), rng.gauss(0, 4e-4), 0.0)],
            }
        )
    return cameras


def draw_motion(rng, motion):
    low, high = MOTIONS[motion][2]
    lane = motion in LANE_MOTIONS
    start = 0.0
    if motion == "get_up":
        start = rng.uniform(3.9, 4.6) if rng.random() < 0.7 else rng.uniform(0, 8)
    elif motion == "sprint_start":
        start = rng.uniform(0, 0.8)
    elif motion != "run":
        start = rng.uniform(0, 10)
    shift = 0.0 if lane or motion == "walk" else 0.35
    return {
        "name": motion,
        "speed": round(rng.uniform(low, high), 3),
        "start_s": round(start, 3),
        "yaw_deg": 0.0 if lane else round(rng.uniform(-180, 180), 1),
        "shift_m": [round(rng.uniform(-shift, shift), 3), round(rng.uniform(-shift, shift), 3)],
    }


def draw_scene(seed, trial, short=False, cameras=None, size=None, fps=None, frames=None, camouflage=None):
    """The scene of a trial as the tables of a scene file; `short`: a second or two, for tests."""
    rng = random.Random(f"kinevox sweep {seed} {trial}")
    kinds = ("trousers", "trousers", "shirt", "both")
    drawn = rng.choice(kinds) if trial % 3 == 0 else ""
    camouflage = drawn if camouflage is None else camouflage
    motion = rng.choice(tuple(MOTIONS))
    rate = fps or rng.choice(RATES)
    seconds = MOTIONS[motion][1] * rng.uniform(0.7, 1.0)
    room = draw_room(rng)
    subject = draw_subject(rng) | draw_clothes(rng, room, camouflage)
    light = draw_light(rng, motion in LANE_MOTIONS)
    moves = draw_motion(rng, motion)
    if motion in LANE_MOTIONS:  # to the end of the lane and no further
        seconds = min(seconds, (3.2 - moves["start_s"]) / moves["speed"] if motion == "sprint_start" else 2.4)
    length = frames or int(min(max(seconds * rate, 20), 60 if short else 140))
    return {
        "seed": rng.randrange(1, 2**31),
        "fps": float(rate),
        "frames": length,
        "background_frames": 40,
        "crf": rng.randint(10, 20),
        "camouflage": camouflage,
        "motion": moves,
        "subject": subject,
        "room": room,
        "light": light,
        "sensor": {"noise_grey": round(rng.uniform(0.7, 3.0), 2), "shot_noise_grey": round(rng.uniform(0, 2.5), 2)},
        "camera": draw_cameras(rng, motion, cameras, size),
    }


GROUP_MOTIONS = ("walk", "walk", "squat", "arm_raise", "stand", "punch", "kick", "jump", "jumping_jack")
WALK_RADIUS_M, WALK_SPEED_M_PER_S = 1.35, 1.3  # of the studio's circle
MIN_APART_M = 0.65  # between the centres of two people, who do not pass through each other


def paths_apart(motions, seconds):
    """The smallest distance of two people, by the studio's paths."""
    nearest = math.inf
    for step in range(int(10 * seconds)):
        centres = []
        for motion in motions:
            x, y = motion["shift_m"]
            if motion["name"] == "walk":
                run = 0.1 * step * motion["speed"] + motion["start_s"]
                angle = math.radians(motion["yaw_deg"]) + WALK_SPEED_M_PER_S * run / WALK_RADIUS_M
                x, y = x + WALK_RADIUS_M * math.cos(angle), y + WALK_RADIUS_M * math.sin(angle)
            centres.append((x, y))
        nearest = min([nearest, *(math.dist(a, b) for i, a in enumerate(centres) for b in centres[:i])])
    return nearest


def draw_group_motions(rng, count, seconds):
    """Motions of people who stay apart; each but the first may enter later or leave early."""
    while True:
        motions = []
        for _ in range(count):
            motion = draw_motion(rng, rng.choice(GROUP_MOTIONS))
            shift = 0.5 if motion["name"] == "walk" else 1.4
            motion["shift_m"] = [round(rng.uniform(-shift, shift), 3) for _ in range(2)]
            motions.append(motion)
        if paths_apart(motions, seconds) >= MIN_APART_M:
            break
    for motion in motions[1:]:
        chance = rng.random()
        if chance < 0.25:
            motion["enter_s"] = round(rng.uniform(0.3, 0.6) * seconds, 2)
        elif chance < 0.4:
            motion["leave_s"] = round(rng.uniform(0.4, 0.7) * seconds, 2)
    return motions


def draw_group(seed, trial):
    """The scene of a trial with two to four people, four to eight cameras of 640 x 480; in every third one is camouflaged."""
    rng = random.Random(f"kinevox people {seed} {trial}")
    count = rng.choices((2, 3, 4), (50, 30, 20))[0]
    cameras = rng.choices((4, 5, 6, 8), (40, 20, 20, 20))[0] if count < 4 else rng.choice((6, 8))
    rate, seconds = rng.choice((15, 20, 25, 25, 30)), rng.uniform(2.5, 3.5)
    room = draw_room(rng)
    motions = draw_group_motions(rng, count, seconds)
    hidden = rng.randrange(count) if trial % 3 == 0 else None
    subjects = []
    for person in range(count):
        camouflage = rng.choice(("trousers", "shirt")) if person == hidden else ""
        subjects.append(draw_subject(rng) | draw_clothes(rng, room, camouflage))
    return {
        "seed": rng.randrange(1, 2**31),
        "fps": float(rate),
        "frames": int(seconds * rate),
        "background_frames": 40,
        "crf": rng.randint(10, 20),
        "camouflage": "" if hidden is None else f"person {'abcd'[hidden]}",
        "motion": motions[0],
        "subject": subjects[0],
        "room": room,
        "light": draw_light(rng, False),
        "sensor": {"noise_grey": round(rng.uniform(0.7, 3.0), 2), "shot_noise_grey": round(rng.uniform(0, 2.5), 2)},
        "camera": draw_cameras(rng, "walk", cameras, (640, 480)),
        "person": [
            {"seed": rng.randrange(1, 2**31), "motion": motion, "subject": subject}
            for motion, subject in zip(motions[1:], subjects[1:])
        ],
    }


def toml_value(value):
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(toml_value(v) for v in value) + "]"
    return repr(value)


def table_lines(header, table):
    """A table after its header, its own tables last."""
    name = header.strip("[]")
    lines = ["", header, *(f"{k} = {toml_value(v)}" for k, v in table.items() if not isinstance(v, dict))]
    for key, part in table.items():
        if isinstance(part, dict):
            lines += table_lines(f"[{name}.{key}]", part)
    return lines


def scene_toml(scene):
    """The scene file of `kinevox studio --scene`."""
    lines = [f"# Camouflage: {scene['camouflage'] or 'none'}."]
    lines += [
        f"{k} = {toml_value(v)}" for k, v in scene.items() if k != "camouflage" and not isinstance(v, (dict, list))
    ]
    for name, table in scene.items():
        for part in table if isinstance(table, list) else [table] if isinstance(table, dict) else []:
            lines += table_lines(f"[[{name}]]" if isinstance(table, list) else f"[{name}]", part)
    return "\n".join(lines) + "\n"
