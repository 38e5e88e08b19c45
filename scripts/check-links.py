#!/usr/bin/env python3
"""Checks that the relative links in the HTML files of a directory, with their anchors, exist.

check-links.py DIRECTORY
"""
import html.parser
import pathlib
import sys
import urllib.parse


class Page(html.parser.HTMLParser):
    def __init__(self, path):
        super().__init__()
        self.links, self.anchors = [], set()
        self.feed(path.read_text())

    def handle_starttag(self, tag, attributes):
        for name, value in attributes:
            if name in ("href", "src") and value:
                self.links.append(value)
            elif name in ("id", "name") and value:
                self.anchors.add(value)


root = pathlib.Path(sys.argv[1]).resolve()
pages = {path: Page(path) for path in root.rglob("*.html")}
faults, count = [], 0
for path, page in pages.items():
    # The page of an error has absolute links, the one for printers those of all pages.
    if path.name in ("404.html", "print.html"):
        continue
    for link in page.links:
        parts = urllib.parse.urlsplit(link)
        if parts.scheme or parts.netloc:
            continue
        count += 1
        target = (path.parent / urllib.parse.unquote(parts.path)).resolve() if parts.path else path
        anchor = urllib.parse.unquote(parts.fragment)
        if not target.exists():
            faults.append(f"{path.relative_to(root)}: {link} does not exist")
        elif anchor and target in pages and anchor not in pages[target].anchors:
            faults.append(f"{path.relative_to(root)}: {link} has no such anchor")
if faults or not count:
    sys.exit("\n".join(sorted(set(faults))) or f"no links in {root}")
print(f"{len(pages)} pages, {count} links")
