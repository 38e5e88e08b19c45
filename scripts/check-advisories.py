#!/usr/bin/env python3
"""Compares Cargo.lock with a local copy of the advisory database (https://github.com/rustsec/advisory-db).

check-advisories.py [DATABASE]        or the environment variable ECAN_ADVISORY_DB

Lists each advisory of a locked version. deny.toml may justify one: an entry of `[advisories] ignore` with `id` and
`reason`. Status 1 for an advisory without a reason, and for a reason without an advisory.
"""
import os
import re
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def parse(version):
    """Order of a version: numbers, then a release after its pre-releases."""
    core, _, pre = version.partition("+")[0].partition("-")
    numbers = [int(part) for part in core.split(".")]
    words = [(0, int(word), "") if word.isdigit() else (1, 0, word) for word in pre.split(".") if word]
    return (*(numbers + [0, 0])[:3], not pre, words)


def upper_bound(text):
    """First version that `^text` excludes."""
    numbers = [int(part) for part in text.partition("-")[0].split(".")]
    at = next((index for index, number in enumerate(numbers) if number), len(numbers) - 1)
    return ".".join(str(number) for number in numbers[:at] + [numbers[at] + 1])


def matches(version, requirement):
    for part in requirement.split(","):
        operator, bound = re.fullmatch(r"\s*(>=|<=|>|<|=|\^|~)?\s*(\S+)\s*", part).groups()
        low, own = parse(bound), parse(version)
        if operator == "~":
            major, minor = (bound.split(".") + ["0"])[:2]
            is_match = low <= own < parse(f"{major}.{int(minor) + 1}")
        else:
            is_match = {
                ">=": own >= low,
                "<=": own <= low,
                ">": own > low,
                "<": own < low,
                "=": own == low,
            }.get(operator, low <= own < parse(upper_bound(bound)))
        if not is_match:
            return False
    return True


def advisories(folder):
    for path in sorted(folder.glob("RUSTSEC-*.md")):
        advisory = tomllib.loads(re.search(r"```toml\n(.*?)```", path.read_text(), re.S).group(1))
        if "withdrawn" not in advisory["advisory"]:
            title = re.search(r"^# (.*)$", path.read_text(), re.M)
            yield advisory, title.group(1) if title else ""


def find(database, lock):
    """Advisories of the locked versions: ID, package, version, kind, title, patched versions."""
    for package in tomllib.loads(lock.read_text())["package"]:
        name, version = package["name"], package["version"]
        for advisory, title in advisories(database / "crates" / name):
            good = advisory["versions"].get("patched", []) + advisory["versions"].get("unaffected", [])
            if not any(matches(version, requirement) for requirement in good):
                fields = advisory["advisory"]
                kind = fields.get("informational", "vulnerability")
                yield fields["id"], name, version, kind, title, advisory["versions"].get("patched", [])


def main():
    path = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("ECAN_ADVISORY_DB")
    if not path:
        print("skipped: advisories: no database; set ECAN_ADVISORY_DB to a copy of rustsec/advisory-db")
        return 0
    database = Path(path)
    if not (database / "crates").is_dir():
        sys.exit(f"{path} is not a copy of rustsec/advisory-db: it has no folder `crates`")
    ignored = tomllib.loads((ROOT / "deny.toml").read_text()).get("advisories", {}).get("ignore", [])
    reasons = {entry["id"]: entry["reason"] for entry in ignored}
    found, is_good = set(), True
    for lock in [ROOT / "Cargo.lock", ROOT / "checks/Cargo.lock"]:
        for identity, name, version, kind, title, patched in find(database, lock):
            found.add(identity)
            reason = reasons.get(identity)
            is_good &= reason is not None
            state = f"justified: {reason}" if reason else f"open; patched: {', '.join(patched) or 'none'}"
            print(f"{identity}: {name} {version} in {lock.relative_to(ROOT)}: {kind}: {title}: {state}")
    for identity in reasons.keys() - found:
        is_good = False
        print(f"{identity}: deny.toml has a reason, but no locked version has the advisory; remove it")
    if is_good:
        print(f"advisories: {len(found)}, each justified")
    return 0 if is_good else 1


sys.exit(main())
