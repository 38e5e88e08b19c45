#!/usr/bin/env python3
"""Prints each unsafe block, function, impl and trait with its reason, as Markdown.

Fails for an unsafe item without a reason.
"""

import re
import subprocess
import sys
from collections import Counter, defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
GENERATED = "ecrt-sys/src/bindings.rs"

# Checks that execute the unsafe code of a path, by scripts/check-undefined-behaviour.sh (Miri, ASan) and
# scripts/check-c.sh (valgrind). The first matching prefix counts.
CHECKS = [
    ("ecan-protocol/src/image/crc/aarch64.rs", "none (qemu runs it)"),
    ("ecan-protocol/", "Miri without the wide CRC, ASan"),
    ("ecrt-sys/", "Miri without foreign calls, ASan, valgrind"),
    ("capi/boundary/", "Miri, ASan, valgrind"),
    ("capi/igh-host/src/encoded.rs", "Miri, ASan, valgrind"),
    ("capi/igh-host/src/handle", "Miri, ASan, valgrind"),
    ("capi/igh-host/src/guard.rs", "Miri without robustness, ASan, valgrind"),
    ("capi/igh-host/src/cia402/settings.rs", "Miri, ASan, valgrind"),
    ("capi/igh-host/", "ASan, valgrind"),
    ("capi/mcan-host/", "ASan, valgrind"),
    ("capi/export/", "ASan, valgrind (the generated code)"),
    ("capi/", "valgrind"),
    ("ecan-host/", "ASan, valgrind"),
    ("ecan-sim/", "ASan, valgrind"),
]

TOKEN = re.compile(
    r"""(?P<line>//[^\n]*)|(?P<block>/\*)|(?P<raw>b?c?r(?P<hash>\#*)")|(?P<string>[bc]?"(?:\\.|[^"\\])*")"""
    r"""|(?P<char>b?'(?:\\(?:x[0-9a-fA-F]{2}|u\{[0-9a-fA-F_]+\}|.)|[^'\\\n])')|(?P<word>[A-Za-z_]\w*)"""
    r"""|(?P<space>\s+)|(?P<other>.)""",
    re.DOTALL,
)


def tokens(text):
    """Words and single characters of the code, with their lines; comments and literals are left out."""
    at, line = 0, 1
    while at < len(text):
        match = TOKEN.match(text, at)
        end = match.end()
        if match.lastgroup == "block" or match.group("block"):
            depth = 1
            while depth:
                found = re.compile(r"/\*|\*/").search(text, end)
                depth += 1 if found.group() == "/*" else -1
                end = found.end()
        elif match.group("raw"):
            end = text.index('"' + match.group("hash"), end) + 1 + len(match.group("hash"))
        elif match.group("string"):
            yield ("literal", line)
        elif match.group("word") or match.group("other"):
            yield (match.group(), line)
        line += text.count("\n", at, end)
        at = end


class Item:
    def __init__(self, kind, path, line):
        self.kind, self.path, self.line = kind, path, line


def name_of(header):
    """Name of the item whose header ends before a brace; None for a block of code."""
    for keyword in ("fn", "mod", "trait", "struct", "union", "enum"):
        if keyword in header:
            after = header[header.index(keyword) + 1 :]
            if after and re.match(r"\w", after[0]):
                return after[0]
    if "macro_rules" in header:
        return header[header.index("macro_rules") + 2] + "!"
    if "impl" in header:
        rest, depth, words = header[header.index("impl") + 1 :], 0, []
        for token in rest:
            if token == "<":
                depth += 1
            elif token == ">":
                depth -= 1
            elif depth == 0 and re.match(r"\w", token):
                if token == "where":
                    break
                words.append(token)
        if "for" in words:
            split = words.index("for")
            traits = [word for word in words[:split] if word not in ("unsafe", "const")]
            types = [word for word in words[split + 1 :] if word not in ("mut", "dyn")]
            return f"{types[-1] if types else '?'} as {traits[-1]}"
        return words[-1] if words else None
    return None


def items(text):
    """The unsafe items of a file."""
    found, stack, header = [], [], []
    stream = list(tokens(text))
    for at, (token, line) in enumerate(stream):
        if token == "unsafe":
            following = [word for word, _ in stream[at + 1 : at + 8]]
            path = "::".join(name for name in stack if name)
            if following[0] == "{":
                own = name_of(header) if "fn" in header else None
                found.append(Item("block", "::".join(filter(None, [path, own])), line))
            elif following[0] in ("impl", "trait"):
                rest = [word for word, _ in stream[at + 1 : at + 40]]
                rest = rest[: rest.index("{")] if "{" in rest else rest
                found.append(Item(following[0], "::".join(filter(None, [path, name_of(rest)])), line))
            elif following[:1] == ["extern"] and following[2] == "{":
                found.append(Item("extern", path, line))
            elif "fn" in following[:3] and following[0] in ("fn", "extern"):
                name = following[following.index("fn") + 1]
                # a name, not the type of a pointer
                if re.match(r"\w|\$", name):
                    if name == "$":
                        name += following[following.index("fn") + 2]
                    found.append(Item("fn", "::".join(filter(None, [path, name])), line))
        if token == "{":
            stack.append(name_of(header))
            header = []
        elif token == "}":
            if stack:
                stack.pop()
            header = []
        elif token == ";":
            header = []
        else:
            header.append(token)
    return found


def comment_above(lines, at):
    """Text of the comment that ends in line `at`, without slashes."""
    first = at
    while first > 0 and lines[first - 1].lstrip().startswith("//"):
        first -= 1
    return [re.sub(r"^\s*//[/!]?\s?", "", line) for line in lines[first : at + 1]]


def reason(item, lines):
    """The SAFETY comment, or the section Safety of the documentation."""
    at = item.line - 1
    inline = re.search(r"// SAFETY: (.*)", lines[at])
    if inline:
        return inline.group(1)
    # the comment is above the statement or the attributes
    for above in range(at - 1, max(at - 12, -1), -1):
        text = lines[above].strip()
        if text.startswith("//"):
            comment = comment_above(lines, above)
            joined = " ".join(line.strip() for line in comment)
            if "SAFETY:" in joined:
                return joined.split("SAFETY:", 1)[1].strip()
            if "# Safety" in joined:
                return re.split(r" #+ ", joined.split("# Safety", 1)[1].strip())[0]
            if item.kind != "block":
                break
        elif item.kind == "block" and (text.endswith(("}", ";")) and above < at - 1 or not text):
            break
        elif item.kind != "block" and not text.startswith(("#[", "pub", ")]", "allow")) and text:
            break
    # one comment for all code that a macro generates in this function
    for above in range(at, max(at - 40, 0), -1):
        if item.kind == "block" and "// SAFETY of " in lines[above]:
            end = above
            while lines[end + 1].lstrip().startswith("//"):
                end += 1
            return " ".join(line.strip() for line in comment_above(lines, end)).split(": ", 1)[1]
    return None


def module_reason(path):
    """The section Safety of the module, or of its parent, for functions of libethercat's interface."""
    for module in (path, path.parent.with_suffix(".rs"), path.parent / "mod.rs"):
        if module.exists():
            head = [line[3:].strip() for line in module.read_text().split("\n") if line.startswith("//!")]
            text = " ".join(head)
            if "# Safety" in text:
                return text.split("# Safety", 1)[1].strip()
    return None


def is_test(path):
    return bool(re.search(r"(^|/)(tests|benches|examples)/|tests?\.rs$|_tests/", path))


def crate_of(path):
    folder = ROOT / path
    while not (folder / "Cargo.toml").exists():
        folder = folder.parent
    return str(folder.relative_to(ROOT))


def cell(text):
    return text.replace("|", "\\|").strip().rstrip(".")


def check_of(path):
    return next((check for prefix, check in CHECKS if path.startswith(prefix)), "none")


def page():
    paths = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", "*.rs"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    ).stdout.split()
    rows, tests, missing, bindings = defaultdict(list), Counter(), [], 0
    for path in sorted(paths):
        if not (ROOT / path).exists():
            continue
        text = (ROOT / path).read_text()
        if "unsafe" not in text:
            continue
        lines = text.split("\n")
        for item in items(text):
            if path == GENERATED:
                bindings += 1
                continue
            why = reason(item, lines)
            if why is None and item.kind == "fn":
                if " as " in item.path:
                    why = "The promise of the trait's function"
                else:
                    why = module_reason(ROOT / path)
            if why is None:
                if is_test(path):
                    tests[path] += 1
                    continue
                missing.append(f"{path}:{item.line}: unsafe {item.kind} in {item.path}: no reason")
            elif is_test(path) or item.path.startswith("tests::"):
                tests[path] += 1
            else:
                rows[crate_of(path)].append((path, item, why))
    return rows, tests, missing, bindings


def render(rows, tests, bindings):
    kinds = Counter(item.kind for crate in rows.values() for _, item, _ in crate)
    out = [
        "# Unsafe code",
        "",
        "Printed by `scripts/list-unsafe.py` from the sources. A reason is the SAFETY comment of a",
        "block or an impl, or the section Safety of a function. `check` names checkers that run code of the folder:",
        "Miri and AddressSanitizer (ASan) by `scripts/check-undefined-behaviour.sh`, valgrind by `scripts/check-c.sh`.",
        "",
        f"{kinds['block']} blocks, {kinds['fn']} functions, {kinds['impl']} impls, {kinds['trait']} traits, "
        f"{kinds['extern']} extern blocks; {sum(tests.values())} in tests and benchmarks; the generated bindings of",
        f"`ecrt.h` (`{GENERATED}`) declare {bindings} functions and blocks.",
    ]
    for crate in sorted(rows):
        out += ["", f"## {crate}", "", "| file | item | kind | reason | check |", "| --- | --- | --- | --- | --- |"]
        counted = Counter()
        for path, item, why in rows[crate]:
            short = path.removeprefix(crate + "/").removeprefix("src/")
            name = f"`{item.path}`" if item.path else ""
            counted[(short, name, item.kind, cell(why), check_of(path))] += 1
        for (short, name, kind, why, check), count in counted.items():
            kind += f" ({count})" if count > 1 else ""
            out.append(f"| {short} | {name} | {kind} | {why} | {check} |")
    out += ["", "## Tests and benchmarks", "", "| file | unsafe items |", "| --- | --- |"]
    out += [f"| {path} | {count} |" for path, count in sorted(tests.items())]
    return "\n".join(out) + "\n"


def main():
    rows, tests, missing, bindings = page()
    if missing:
        sys.exit("\n".join(missing) + "\nlist-unsafe.py: write a SAFETY comment or a section # Safety")
    print(render(rows, tests, bindings), end="")


main()
