#!/usr/bin/env python3
"""Translates a .cu file for a C++ compiler and the emulator.   usage: translate_launches.py IN.cu OUT.cc

kernel<<<grid, block, shared, stream>>>(...) becomes a call of cuda_emulator::launcher(), and each __shared__ variable a
reference to the running block's memory. Lines keep their numbers.
"""
import re
import sys

LAUNCH = re.compile(r"([A-Za-z_]\w*(?:<[\w, ]+>)?)\s*<<<(.*?)>>>\s*\(", re.S)
SHARED = re.compile(r"(extern\s+)?__shared__\s+([^;=]+?)\s+(\w+\s*(?:\[[^;]*?\]\s*)*(?:,[^;]*)?);")
DECLARATOR = re.compile(r"\s*(\w+)\s*((?:\[[^\]]*\]\s*)*)")


def shared_variables(match):
    """The references that replace one declaration of __shared__ variables."""
    is_extern, kind, declarators = match.groups()
    out = []
    for declarator in declarators.split(","):
        name, extents = DECLARATOR.fullmatch(declarator).groups()
        if is_extern:
            out.append(f"auto* {name} = static_cast<{kind}*>(::cuda_emulator::dynamic_shared_memory());")
        else:
            out.append(f'auto& {name} = ::cuda_emulator::shared_variable<{kind}{extents}>([] {{}}, "{name}");')
    return " ".join(out)


def main():
    source, target = sys.argv[1:]
    with open(source) as file:
        text = file.read()
    text = LAUNCH.sub(lambda m: f'::cuda_emulator::launcher({{{m[2]}}}, "{m[1]}", {m[1]})(', text)
    text = SHARED.sub(shared_variables, text)
    for construct in ("<<<", "__shared__"):
        if construct in text:
            sys.exit(f"{source}: {construct} is used in a way that translate_launches.py does not handle")
    with open(target, "w") as file:
        file.write(f'#line 1 "{source}"\n{text}')


main()
