"""The table of deploy/gpu-proof, from the results of its steps."""
import json
import tomllib

RESULTS = ("build", "facts", "tests", "exact", "calls", "stages", "sanitizers", "profile")


def rows_of(header, rows):
    """A Markdown table; numbers are aligned right."""
    aligned = ["---" if n == 0 else "---:" for n in range(len(header))]
    return "\n".join("| " + " | ".join(str(cell) for cell in row) + " |" for row in [header, aligned, *rows]) + "\n"


def number(value, digits=3):
    """At most `digits` significant digits, without an exponent."""
    if value is None:
        return "-"
    if isinstance(value, int) or abs(value) >= 10 ** (digits - 1):
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def goals_table(goals, measures):
    """Each goal with what was measured, and PASS or FAIL."""
    rows = []
    for goal in goals:
        value = measures.get(goal["measure"])
        verdict = "not measured" if value is None else "PASS" if value <= goal["max"] else "FAIL"
        rows.append([goal["what"], number(goal["max"]), number(goal.get("push")), number(value), verdict])
    return "## Goals\n\n" + rows_of(["goal", "at most", "then", "measured", "verdict"], rows)


def exact_table(rows):
    """CPU against CUDA form by stage and size."""
    cells = []
    for row in rows:
        emulator = "-" if "emulator" not in row else "yes" if row["emulator"] == row["cuda_hash"] else "no"
        cells.append([row["stage"], row["size"], row["values"], row["different"], emulator])
    return "## CPU against CUDA\n\n" + rows_of(["stage", "size", "values", "different", "card as emulator"], cells)


def stages_table(rows):
    """Times of each benchmark on both devices."""
    cells = []
    for row in rows:
        times = [row.get(f"{device}_{key}") for device in ("cpu", "cuda") for key in ("median_us", "p99_us")]
        ratio = number(times[0] / times[2], 2) if times[0] and times[2] else "-"
        cells.append([row["name"], *(number(time) for time in times), row.get("cuda_iterations", "-"), ratio])
    header = ["benchmark, us", "CPU median", "p99", "CUDA median", "p99", "iterations", "CPU / CUDA"]
    text = "Uploads, and downloads of what the next stage needs, included.\n\n"
    return "## Stages\n\n" + text + rows_of(header, cells)


def kernels_table(rows):
    """The longest kernels of a frame set."""
    cells = [
        [f"`{row['name']}`", *(number(row[key]) for key in ("launches", "us", "occupancy", "dram")), row["registers"]]
        for row in rows
    ]
    header = ["kernel, per frame set", "launches", "us", "warps active, %", "DRAM, % of peak", "registers"]
    return "## Longest kernels\n\nBy Nsight Compute, 4 x 640x480, 10 mm, one kernel at a time.\n\n" + rows_of(
        header, cells
    )


def make(folder, goals_file):
    """The whole page. Without the steps that were not executed; failed ones are listed."""
    steps = {name: json.loads(path.read_text()) for name in RESULTS if (path := folder / f"{name}.json").is_file()}
    with open(goals_file, "rb") as file:
        goals = tomllib.load(file)["goal"]
    measures = {key: value for step in steps.values() for key, value in step.get("measures", {}).items()}
    facts, build = steps.get("facts", {}), steps.get("build", {})
    text = f"# {build['card']}\n\n"
    text += f"`deploy/gpu-proof` on {build['device']}, {build['date']}, commit {build['commit']}, beside {build['cpu']}.\n\n"
    if build["card"] == "emulator":
        text += "Executed on the CPU at small sizes: the times say nothing about a GPU.\n\n"
    text += goals_table(goals, measures) + "\n"
    for name, step in steps.items():
        if step["problem"]:
            text += f"Step {name} could not be executed completely: {step['problem']}\n\n"
    if facts.get("rates"):
        rows = [[name, value, unit] for name, value, unit in facts["rates"]]
        rows += [[name.replace(".", " ").replace("_", " "), value, ""] for name, value in facts.get("facts", [])]
        text += "## Card\n\n" + rows_of(["what", "value", "unit"], rows) + "\n"
    if "executed" in steps.get("tests", {}):
        tests = steps["tests"]
        text += f"## Tests\n\n{tests['executed']} kernel tests executed, {tests['failed']} failed, {tests['skipped']} skipped"
        text += f": {', '.join(tests['failed_names'])}.\n\n" if tests["failed"] else ".\n\n"
    if steps.get("sanitizers", {}).get("rows"):
        text += "## compute-sanitizer\n\n" + rows_of(["tool", "findings"], steps["sanitizers"]["rows"]) + "\n"
    for name, table in (("exact", exact_table), ("stages", stages_table), ("profile", kernels_table)):
        if steps.get(name, {}).get("rows"):
            text += table(steps[name]["rows"]) + "\n"
    seconds = ", ".join(f"{name} {step['seconds']:.0f}" for name, step in steps.items())
    return text + f"Seconds per step: {seconds}.\n"
