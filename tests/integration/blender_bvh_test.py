#!/usr/bin/python3
"""Blender's BVH importer on files of `kinevox export`. usage: blender_bvh_test.py KINEVOX_EXPORT MAKE_POSED_TRIAL

Every bone's head, in every frame, must be at the joint's position by our forward kinematics of the file. Skips (77)
without Debian's package blender."""
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

import motion_files

# Runs in Blender; units and axes of the file are kept. Blender 3.4 opens the file in mode 'U', which Python 3.11 rejects;
# only that is replaced.
INSIDE = """
import builtins, bpy, json, sys
own_open = builtins.open
builtins.open = lambda file, mode='r', *rest, **named: own_open(file, mode.replace('U', ''), *rest, **named)
bvh, out = sys.argv[sys.argv.index('--') + 1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.import_anim.bvh(filepath=bvh, axis_forward='Y', axis_up='Z', rotate_mode='NATIVE', use_fps_scale=False,
                        update_scene_fps=False, update_scene_duration=True)
armature = next(o for o in bpy.data.objects if o.type == 'ARMATURE')
scene = bpy.context.scene
heads = {bone.name: [] for bone in armature.pose.bones}
for frame in range(scene.frame_start, scene.frame_end + 1):
    scene.frame_set(frame)
    for bone in armature.pose.bones:
        heads[bone.name].append(list(armature.matrix_world @ bone.head))
json.dump(heads, open(out, 'w'))
"""


def main():
    export, make_trial = sys.argv[1:]
    if not shutil.which("blender"):
        print("skipped: Debian's package blender is not installed, so its importer has not read the file")
        return 77
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        subprocess.run([make_trial, str(folder / "trial")], check=True)
        bvh, heads_file, script = folder / "trial.bvh", folder / "heads.json", folder / "inside.py"
        subprocess.run(
            [export, str(folder / "trial"), "--format", "bvh", "--out", str(bvh), "--quiet", "--hold-withheld"],
            check=True,
        )
        script.write_text(INSIDE)
        run = subprocess.run(
            [
                "blender",
                "--background",
                "--factory-startup",
                "--python-exit-code",
                "3",
                "--python",
                str(script),
                "--",
                str(bvh),
                str(heads_file),
            ],
            capture_output=True,
            text=True,
            timeout=200,
        )
        if run.returncode != 0:
            print(run.stdout[-2000:], run.stderr[-2000:])
            return 1
        heads = json.loads(heads_file.read_text())
        file = motion_files.Bvh(bvh)
        positions = [file.positions(frame) for frame in range(len(file.motion))]
        worst, compared = 0.0, 0
        for name in file.names:
            if name not in heads:
                continue  # an end site, in Blender the tail of its bone
            ours = np.array([frame[name] for frame in positions])
            theirs = np.array(heads[name])[: len(ours)]
            if len(theirs) != len(ours):
                print(f"Blender has {len(theirs)} frames, the file {len(ours)}")
                return 1
            worst = max(worst, np.abs(theirs - ours).max())
            compared += 1
        print(
            f"{compared} joints, {len(positions)} frames: Blender's heads lie within {worst:.4f} cm of the file's joints"
        )
        return 0 if compared >= 15 and worst < 0.01 else 1


if __name__ == "__main__":
    sys.exit(main())
