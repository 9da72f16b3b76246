"""What runs survive: killed processes and damaged files, counted by the tests that make them."""

import subprocess
import sys
import tempfile
import xml.etree.ElementTree as tree
from pathlib import Path

from benchmarks.common import report
from benchmarks.common.report import Result, Track

X64 = True
TESTS = Path(__file__).resolve().parents[2] / "tests"
PARTS = {
    "kills": ("tiles/test_refine.py", "test_kills_lose_nothing"),
    "files": ("io/test_fuzz_io.py", "test_damaged_files_end_in_one_line"),
}


def run(track: Track = report.silent) -> Result:
    """Run those tests and collect what they count; a test that fails raises."""
    rows = []
    for what, (file, name) in track(list(PARTS.items()), "reliability"):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "report.xml"
            # Properties of tests belong to the older kind of report.
            command = [sys.executable, "-m", "pytest", "-q", "-o", "junit_family=xunit1"]
            command += ["-m", "slow", "-k", name]
            subprocess.run(
                [*command, f"--junitxml={path}", str(TESTS / file)],
                check=True,
                stdout=subprocess.DEVNULL,
            )
            for case in tree.parse(path).iter("testcase"):
                of = case.attrib["name"].removeprefix(name).strip("[]")
                found = {p.attrib["name"]: p.attrib["value"] for p in case.iter("property")}
                if what in found:
                    rows.append({"what": what, "of": of, "count": int(found[what])})
    return {"rows": rows}


def tables(result: Result) -> dict[str, str]:
    """Counts of what was done to runs and files; all passed, or there were no table."""
    rows: list[list[object]] = []
    files: dict[int, list[str]] = {}
    for row in result["rows"]:
        if row["what"] == "files":
            files.setdefault(row["count"], []).append(row["of"])
            continue
        suffix, workers, _ = row["of"].split("-")
        shared = "1 process" if workers == "1" else f"{workers} processes"
        rows.append([f"runs to {suffix} in {shared}, killed and resumed", row["count"]])
    for count, formats in files.items():
        names = f"damaged files of {len(formats)} kinds: {', '.join(formats)}"
        rows.append([names, f"{count} each"])
    return {"reliability": report.table(["survived", "count"], rows)}
