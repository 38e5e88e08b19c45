#!/usr/bin/env python3
"""Checks that what the documents name exists: files, links, tests, types, fields, keys, constants and options."""
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
DOCUMENTS = ["README.md", "CONTRIBUTING.md", "API.md", "docs/*.md", "docs/guide/*.md"]
# The host's system and its programs: their names are not those of the project.
FOREIGN_DOCUMENTS = {"docs/guide/bare-machine-to-op.md"}
FOREIGN = set(
    "PO2SOconfig RuntimeWatchdogSec SO_PEERCRED TRIPLET UPDOWN_INTERFACES can_interface_name ecx_config_init host0 "
    "pthread_cancel pthread_setcancelstate record_fault regressions slavelist vX".split()
)
FILE = re.compile(r"\S+/\S+\.(rs|sh|py|md|c|h|hpp|lua|toml)|\S+\.(rs|sh|py|md|c|lua)")


def sources():
    """Names and texts of the files that are not documents."""
    names = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.splitlines()
    paths = [ROOT / name for name in names if not name.endswith(".md")]
    return {path: path.read_text(errors="replace") for path in paths if path.is_file()}


def declared_members(texts):
    """For each type of Rust, the words of the files that declare or implement it."""
    words = {}
    for path, text in texts.items():
        if path.suffix == ".rs":
            types = re.findall(r"\b(?:struct|enum|trait|type|impl(?:<[^>]*>)?(?: [\w:]+ for)?) ([A-Z]\w+)", text)
            inside = set(re.findall(r"\w+", text)) if types else set()
            for name in types:
                words.setdefault(name, set()).update(inside)
    return words


def faults_of(document, text, texts, words, options, members):
    quoted = set(re.findall(r"`([^`\n]+)`", text))
    for link in set(re.findall(r"\]\(([^)#:]+)[)#]", text)):
        if not (document.parent / link).exists():
            yield f"link {link}"
    for name in quoted:
        is_file = FILE.fullmatch(name) and not re.search(r"[<*$]|^/|^linux/", name)
        if is_file and "/" in name and not any((ROOT / top / name).exists() for top in ("", "docs", "ecan-sim/src")):
            yield name
        function = re.fullmatch(r"[a-z]\w*::(\w+_\w+)", name)
        if function and function[1] not in words:
            yield name
        for kind, member in re.findall(r"\b([A-Z]\w+)::(\w+)", name):
            if kind in members and member not in members[kind]:
                yield f"{kind}::{member}"
    if str(document.relative_to(ROOT)) in FOREIGN_DOCUMENTS:
        return
    for option in set(re.findall(r"(?:^|[ `|\[(])(--[a-z][a-z0-9-]+)", text, re.M)):
        if option not in options and option[2:].replace("-", "_") not in words:
            yield option
    for name in quoted:
        if not re.search(r"[ $*<]|^[/-]", name):
            for word in re.findall(r"\w+", name):
                # A part of a name begins or ends with an underscore.
                is_name = re.fullmatch(r"[A-Za-z]\w*[A-Za-z0-9]", word) and not re.fullmatch(r"f?NN?", word)
                # Values of JSON are variants of Rust.
                is_known = word in words or word in FOREIGN or word.title().replace("_", "") in words
                if is_name and not is_known and f"{word}_" not in name:
                    yield word


def main():
    texts = sources()
    words = set(re.findall(r"\w+", "\n".join(texts.values())))
    options = set(re.findall(r"--[a-z][a-z0-9-]+", "\n".join(texts.values())))
    members, missing = declared_members(texts), 0
    for document in sorted(path for pattern in DOCUMENTS for path in ROOT.glob(pattern)):
        for fault in sorted(set(faults_of(document, document.read_text(), texts, words, options, members))):
            print(f"{document.relative_to(ROOT)}: {fault} does not exist")
            missing += 1
    if missing:
        sys.exit(1)
    print("all files, tests, names and options that the documents name exist")


main()
