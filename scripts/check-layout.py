#!/usr/bin/env python3
"""Checks the layout of the workspace: dependencies of crates point downwards, files of a crate do not import
each other in circles, and no source file has more than 600 lines of code.

    scripts/check-layout.py            prints each violation, and fails if there is one
"""

import json
import re
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
MAX_LINES = 600
# From the bottom to the top. A crate depends on crates of earlier lines only.
LAYERS = [
    "ecan-test-support",
    "ecan-protocol ecan-c-export",
    "ecrt-sys",
    "ecan-host",
    "ecan-mcan-port",
    "ecan-canopen",
    "ecan-cia402",
    "ecan-can-io",
    "ecan-sim",
    "ecan-service",
    "ecan-service-zenoh",
    "ecan-lite",
    "ecan-c-boundary",
    "ecan-mcan-host",
    "ecan-igh-host ecan-sim-ethercat",
    "ecan-tool-support",
    "ecan-tool",
    "ecan-examples",
]
# Tests run on the simulator, whatever the layer.
TEST_DEPENDENCIES = {"ecan-sim", "ecan-test-support"}
TEST_FILE = re.compile(r"(^|/)(tests?|.*_tests?|test_.*|properties)\.rs$|/tests/")


def metadata():
    command = ["cargo", "metadata", "--no-deps", "--format-version", "1", "--locked", "--offline"]
    return json.loads(subprocess.run(command, cwd=ROOT, check=True, capture_output=True).stdout)["packages"]


def arrows(packages):
    """Dependencies that point upwards or sideways."""
    level = {name: at for at, line in enumerate(LAYERS) for name in line.split()}
    for package in packages:
        name = package["name"]
        if name not in level:
            yield f"{name}: not among the layers of scripts/check-layout.py"
            continue
        for dependency in package["dependencies"]:
            other = dependency["name"]
            if dependency.get("path") is None or other == name:
                continue
            if dependency["kind"] == "dev" and other in TEST_DEPENDENCIES:
                continue
            if level.get(other, len(LAYERS)) >= level[name]:
                yield f"{name}: depends on {other}, which is not below it ({dependency['kind'] or 'normal'})"


def code_of(text):
    """The code without comments, strings and unit tests."""
    text = re.sub(r"^#\[cfg\(test\)\]\nmod \w+ \{\n.*?^\}", "", text, flags=re.M | re.S)
    text = re.sub(r"//[^\n]*", "", text)
    return re.sub(r'"(?:\\.|[^"\\])*"', '""', text, flags=re.S)


def expand(tree, prefix=()):
    """The paths of a use tree, with the names that they bind."""
    tree = tree.strip()
    group = re.match(r"^((?:\w+\s*::\s*)*)\{(.*)\}$", tree, re.S)
    if group:
        prefix += tuple(part.strip() for part in group[1].split("::") if part.strip())
        depth, start, inner = 0, 0, group[2]
        for at, char in enumerate(inner + ","):
            depth += {"{": 1, "}": -1}.get(char, 0)
            if char == "," and depth == 0:
                if inner[start:at].strip():
                    yield from expand(inner[start:at], prefix)
                start = at + 1
        return
    path, _, alias = tree.partition(" as ")
    path = prefix + tuple(part.strip() for part in path.split("::"))
    if path[-1] == "self":
        path = path[:-1]
    yield path, alias.strip() or path[-1]


class Crate:
    """The modules of a crate and what they import from each other."""

    def __init__(self, root):
        self.base = root.parent
        self.files, self.code = {}, {}
        for file in sorted(self.base.rglob("*.rs")):
            parts = file.relative_to(self.base).with_suffix("").parts
            if parts[0] == "bin" or file.name in ("lib.rs", "main.rs") and file != root:
                continue
            if TEST_FILE.search(str(file.relative_to(ROOT))):
                continue
            module = () if file == root else parts[:-1] if parts[-1] == "mod" else parts
            self.files[module] = file
            self.code[module] = code_of(file.read_text())
        self.exports = defaultdict(dict)
        self.globs = defaultdict(list)
        self.uses = defaultdict(set)
        for module, code in self.code.items():
            self.read(module, code)

    def absolute(self, module, path):
        if path[0] == "crate":
            return path[1:]
        if path[0] in ("self", "super"):
            while path and path[0] in ("self", "super"):
                module = module[:-1] if path[0] == "super" else module
                path = path[1:]
            return module + path
        return module + path if module + path[:1] in self.files else None

    def read(self, module, code):
        statement = re.compile(r"^[ \t]*(pub(?:\([^)]*\))?[ \t]+)?use\s+([^;]+);", re.M)
        for use in statement.finditer(code):
            for path, name in expand(use[2]):
                target = self.absolute(module, path)
                if target is None:
                    continue
                if not use[1]:
                    self.uses[module].add(target)
                elif name == "*":
                    self.globs[module].append(target[:-1])
                else:
                    self.exports[module][name] = target
        for path in re.findall(r"(?<![\w:$])(?:crate|super|self)(?:::\w+)+", statement.sub("", code)):
            target = self.absolute(module, tuple(path.split("::")))
            if target:
                self.uses[module].add(target)

    def owner(self, target, depth=0):
        """The module whose file has the item."""
        module = ()
        while len(module) < len(target) and target[: len(module) + 1] in self.files:
            module = target[: len(module) + 1]
        rest = target[len(module) :]
        if not rest or rest[0] == "*" or depth > 9:
            return module
        if rest[0] in self.exports[module]:
            return self.owner(self.exports[module][rest[0]] + rest[1:], depth + 1)
        item = re.compile(rf"\b(?:fn|struct|enum|trait|const|static|type|union|macro_rules!)\s+{rest[0]}\b")
        if not item.search(self.code.get(module, "")):
            for glob in self.globs[module]:
                found = self.owner(glob + rest, depth + 1)
                if item.search(self.code.get(found, "")):
                    return found
        return module

    def circles(self):
        edges = {}
        for module in self.files:
            owners = {self.owner(target) for target in self.uses[module]}
            # The root and modules with children only declare them.
            edges[module] = {o for o in owners if o != module and o in self.files and o != ()}
        index, low, stack, found = {}, {}, [], []
        sys.setrecursionlimit(10_000)

        def visit(node):
            index[node] = low[node] = len(index)
            stack.append(node)
            for other in edges[node]:
                if other not in index:
                    visit(other)
                if other in stack:
                    low[node] = min(low[node], low[other])
            if low[node] == index[node]:
                at = stack.index(node)
                if len(stack) - at > 1:
                    found.append(sorted(str(self.files[n].relative_to(ROOT)) for n in stack[at:]))
                del stack[at:]

        for module in self.files:
            if module not in index:
                visit(module)
        return found


def main():
    packages = metadata()
    faults = list(arrows(packages))
    for package in packages:
        for target in package["targets"]:
            if set(target["kind"]) & {"lib", "staticlib", "bin", "proc-macro"}:
                for circle in Crate(Path(target["src_path"])).circles():
                    fault = f"circle of files: {', '.join(circle)}"
                    # The binary of a package sees the files of its library.
                    if fault not in faults:
                        faults.append(fault)
    listed = subprocess.run(["git", "ls-files", "*.rs"], cwd=ROOT, check=True, capture_output=True, text=True)
    for name in listed.stdout.split():
        if not (ROOT / name).exists():
            continue
        if "/src/" not in name or TEST_FILE.search(name) or name.endswith("bindings.rs"):
            continue
        lines = (ROOT / name).read_text().split("\n")
        count = sum(1 for line in lines if line.strip() and not line.lstrip().startswith("//"))
        if count > MAX_LINES:
            faults.append(f"{name}: {count} lines of code; allowed: {MAX_LINES}")
    print("\n".join(faults) or "crates and files point downwards")
    sys.exit(bool(faults))


main()
