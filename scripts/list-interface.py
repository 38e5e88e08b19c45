#!/usr/bin/env python3
"""Lists everything that users see, one item a line, to compare two commits or releases:

    scripts/list-interface.py DIRECTORY [--rust]
    diff -r BEFORE AFTER

Writes functions, fields and constants of the C headers (c.txt), commands with their options and exit statuses
(commands.txt), keys of the configuration file (keys.txt), texts of the programs and errors (messages.txt), and with
--rust the public items of each published crate (needs a nightly toolchain and cargo-public-api).
"""
import json
import pathlib
import re
import subprocess
import sys
import tempfile

CRATES = ["protocol", "host", "mcan-port", "canopen", "cia402", "can-io", "sim", "service", "lite"]
LITERAL = re.compile(r'(?<![\w\'])b?r?(#*)"((?:[^"\\]|\\.)*)"\1', re.S)


def run(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def sources():
    for name in run("git", "ls-files", "*.rs").splitlines():
        is_test = re.search(r"(^|/)(tests?|benches|fuzz|checks|test-support)/|_tests?\.rs$|(^|/)tests\.rs$", name)
        if "/src/" in name and not is_test:
            yield pathlib.Path(name).read_text()


def messages():
    """String literals with a blank between words, without documentation and tests, whitespace joined."""
    found = set()
    for text in sources():
        text = re.sub(r"^#\[cfg\(test\)\]\nmod \w+ \{.*?^\}", "", text, flags=re.M | re.S)
        text = re.sub(r"^\s*//.*$", "", text, flags=re.M)
        for match in LITERAL.finditer(text):
            literal = re.sub(r"\\\n\s*", "", match[2])
            literal = re.sub(r"\{[^{}]*\}", "{}", " ".join(literal.split()))
            if re.search(r"\w[,;:]? \w", literal):
                found.add(literal)
    return sorted(found)


def c_items():
    for header in sorted(pathlib.Path("include").rglob("*.h*")):
        text = re.sub(r"/\*.*?\*/|//[^\n]*", "", header.read_text(), flags=re.S)
        for line in text.replace("\\\n", " ").splitlines():
            line = " ".join(line.split())
            if line and line not in "{}":
                yield f"{header.name}: {line}"


def program(name):
    run("cargo", "build", "--quiet", "--locked", "-p", "ecan-tool", "--bins")
    return json.loads(run("cargo", "metadata", "--no-deps", "--format-version", "1"))["target_directory"] + f"/debug/{name}"


def commands():
    with tempfile.TemporaryDirectory() as directory:
        run(program("ecan"), "man", directory)
        for page in sorted(pathlib.Path(directory).iterdir()):
            for line in page.read_text().splitlines():
                yield f"{page.name}: {line}"
    yield from run(program("ecan-sim"), "--help").splitlines()


def keys(schema, path=""):
    """Dotted keys of a JSON schema, with type and limits."""
    if isinstance(schema, list):
        for inner in schema:
            yield from keys(inner, path)
    elif isinstance(schema, dict):
        limits = {name: value for name, value in schema.items() if not isinstance(value, (dict, list)) and name != "description"}
        if path and limits:
            yield f"{path} {json.dumps(limits, sort_keys=True)}"
        for name, value in schema.items():
            if name in ("properties", "patternProperties", "$defs", "definitions"):
                for key, inner in value.items():
                    yield from keys(inner, f"{path}.{key}")
            elif name != "description":
                yield from keys(value, path)


def main():
    arguments = sys.argv[1:]
    with_rust = "--rust" in arguments
    directories = [word for word in arguments if word != "--rust"]
    if len(directories) != 1 or directories[0].startswith("-"):
        sys.exit(__doc__)
    output = pathlib.Path(directories[0])
    output.mkdir(parents=True, exist_ok=True)

    def write(name, lines):
        (output / name).write_text("".join(f"{line}\n" for line in lines))

    write("c.txt", c_items())
    write("messages.txt", messages())
    write("commands.txt", commands())
    write("keys.txt", sorted(set(keys(json.loads(run(program("ecan"), "config", "schema"))))))
    if with_rust:
        for crate in CRATES:
            command = ["cargo", "+nightly", "public-api", "-p", f"ecan-{crate}", "--all-features", "-sss"]
            write(f"rust-{crate}.txt", run(*command).splitlines())


if __name__ == "__main__":
    main()
