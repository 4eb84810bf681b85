#!/usr/bin/env python3
"""Checks the documentation against the programs.

usage: check_docs.py links|units|commands|examples|tests|attacks PROJECT_ROOT FOLDER_OF_PROGRAMS

links     every relative link leads to a file, and to a heading of that page where it names one
units     a systemd unit that is started again and again is not given up by systemd's limit of starts
commands  every command has a page, and the page names every option that --help lists
examples  code blocks that begin with ```sh test run with exit code 0, those of one page one after the other, two pages at a time
tests     every test that docs/trust.md and docs/sync.md name is there, and so is every code that an attack gets
attacks   docs/attacks.md names exactly the attacks of ./run bench attacks, and tests that are there; every finding of the
          review has an attack
"""
import ast
import concurrent.futures
import os
import pathlib
import re
import subprocess
import sys
import tempfile


# Attacks on a package that must fail; each has a row of its own in docs/trust.md, which names its tests.
ATTACKS = ["tampered file", "tiles swapped digests", "another mission airframe", "rollback of a package", "freeze",
           "mix and match", "endless data", "partial write power cut", "revoked key", "rotated key",
           "paths absolute links twins", "duplicate keys floats nesting unknown", "every byte manifest signature flipped",
           "one byte every page"]


# Attacks on the candidate service, likewise in docs/sync.md.
SERVICE_ATTACKS = ["replayed batch", "swapped tile", "forged airframe", "revoked key", "path tricks names", "oversized pack",
                   "zip-bomb", "false sizes", "slow-loris", "clock tricks"]


def pages(root):
    return [root / "README.md", *sorted((root / "docs").rglob("*.md"))]


def anchors(page):
    """As GitHub makes them: of a heading's text without its links' targets, lower case, words joined by hyphens; repeated ones are numbered."""
    text = re.sub(r"^ *```.*?^ *```", "", page.read_text(), flags=re.M | re.S)
    seen = {}
    for heading in re.findall(r"^#+ +(.*?) *$", text, re.M):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).lower()
        slug = re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")
        seen[slug] = seen.get(slug, -1) + 1
        yield f"{slug}-{seen[slug]}" if seen[slug] else slug


def check_links(root, _):
    for page in [*pages(root), root / "CHANGELOG.md", root / "CONTRIBUTING.md"]:
        for target, anchor in re.findall(r"\]\(([^)#\s]*)(?:#([^)]*))?\)", page.read_text()):
            if target.startswith(("http://", "https://")):
                continue
            linked = page.parent / target if target else page
            if not linked.exists():
                yield f"{page.relative_to(root)}: no such file: {target}"
            elif anchor and linked.suffix == ".md" and anchor not in anchors(linked):
                yield f"{page.relative_to(root)}: no such heading: {target}#{anchor}"


def check_units(root, _):
    units = [(page, unit) for page in pages(root) for unit in re.findall(r"^```ini\n(.*?)^```", page.read_text(), re.M | re.S)]
    if not units:
        yield "no page shows a unit"
    for page, unit in units:
        if "\nRestart=always" in unit and "\nStartLimitIntervalSec=0" not in unit:
            yield f"{page.relative_to(root)}: after five starts in ten seconds this unit stays dead: {unit.splitlines()[1]}"


def output_of(*args):
    return subprocess.run(args, capture_output=True, text=True, check=True).stdout


# Programs with commands, and how the names of their commands' pages begin.
PROGRAMS = {"nadir": "", "nadir-candidates": "candidates-"}


def check_commands(root, programs):
    index = (root / "docs/commands/index.md").read_text()
    for program, prefix in PROGRAMS.items():
        listed = output_of(programs / program, "--help").split("Commands:\n")[1].split("\n\n")[0]
        for line in listed.splitlines():
            words = re.split(r"\s{2,}", line.strip())[0].split()
            name = prefix + "-".join(words)
            page = root / "docs" / "commands" / f"{name}.md"
            if f"({name}.md)" not in index:
                yield f"docs/commands/index.md does not list {name}.md"
            if not page.exists():
                yield f"docs/commands/{name}.md is missing"
                continue
            text = page.read_text()
            for option in re.findall(r"^\s+(--[a-z-]+)", output_of(programs / program, *words, "--help"), re.M):
                if option not in text and option != "--quiet":
                    yield f"docs/commands/{name}.md does not mention {option}"


def check_example(page, blocks, root, programs):
    """What is wrong with the examples of one page, run one after the other in a folder of their own."""
    with tempfile.TemporaryDirectory(prefix="nadir-docs.") as folder:
        result = subprocess.run(["bash", "-euo", "pipefail", "-c", "".join(blocks)], cwd=folder, text=True,
                                stdin=subprocess.DEVNULL, capture_output=True, check=False,
                                env={**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"})
    if result.returncode != 0:
        return f"{page.relative_to(root)}: the example ends with {result.returncode}\n{result.stdout}{result.stderr}"
    return None


def check_examples(root, programs):
    examples = {page: re.findall(r"^```sh test\n(.*?)^```", page.read_text(), re.M | re.S) for page in pages(root)}
    examples = {page: blocks for page, blocks in examples.items() if blocks}
    if not examples:
        yield "no example is marked ```sh test"
    with concurrent.futures.ThreadPoolExecutor(max_workers=2) as pool:  # as PROCESSORS tells ctest
        longest_first = sorted(examples, key=lambda page: -len("".join(examples[page])))
        yield from filter(None, pool.map(lambda page: check_example(page, examples[page], root, programs), longest_first))


def check_tests(root, _):
    sources = "\n".join(source.read_text() for source in (root / "tests").rglob("*_test.cpp"))
    yield from check_attacks(root / "docs/trust.md", "| attack | tests |\n|---|---|\n", ATTACKS, sources)
    yield from check_attacks(root / "docs/sync.md", "| attack | answer | tests |\n|---|---|---|\n", SERVICE_ATTACKS, sources)
    # What the service answers: reasons of the closed list, problems and statuses that it knows.
    known = "".join((root / path).read_text() for path in ("libgeo/upload/reason_code.cpp", "tools/nadir_candidates/upload_api.cpp",
                                                          "schemas/candidates.openapi.yaml"))
    for row in rows_after((root / "docs/sync.md").read_text(), "| attack | answer | tests |\n|---|---|---|\n"):
        for code in re.findall(r"`([^`]+)`", row[1]):
            if not re.search(rf"\b{re.escape(code)}\b", known):
                yield f"docs/sync.md: the service has no such answer: {code}"


def rows_after(text, head):
    return [row.strip("| ").split(" | ") for row in text.split(head)[1].split("\n\n")[0].splitlines()]


def check_attacks(page, head, expected, sources):
    text = page.read_text()
    named = re.findall(r"`([A-Z]\w+)\.([A-Z]\w+)`", text)
    if not named:
        yield f"{page.name} names no test"
    rows = rows_after(text, head)
    for row in rows:
        if not re.search(r"`[A-Z]\w+\.[A-Z]\w+`", row[-1]):
            yield f"{page.name}: no test shows that this attack fails: {row[0]}"
    for words in expected:
        if not any(all(word in row[0] for word in words.split()) for row in rows):
            yield f"{page.name}: no row for the attack: {words}"
    for suite, name in named:
        if not re.search(rf"TEST(_F|_P)?\({suite}, {name}\)", sources):
            yield f"{page.name}: no such test: {suite}.{name}"


# The findings of the review of 2026, each of which an attack replays.
REVIEW = [*(f"H{i}" for i in range(1, 7)), *(f"M{i}" for i in range(1, 13)), *(f"L{i}" for i in range(1, 12)), "FS"]


def registered_attacks(folder):
    """{name: its finding of the review, or ""}: the functions under @attack, read without importing them."""
    found = {}
    for module in sorted(folder.glob("*.py")):
        for function in ast.parse(module.read_text()).body:
            for mark in getattr(function, "decorator_list", []):
                if isinstance(mark, ast.Call) and getattr(mark.func, "id", "") == "attack":
                    found[f"{module.stem}.{function.name}"] = mark.args[0].value if mark.args else ""
    return found


def check_bench_attacks(root, _):
    registry = registered_attacks(root / "tests" / "bench" / "attacks")
    if not registry:
        yield "tests/bench/attacks registers no attack"
    text = (root / "docs/attacks.md").read_text()
    attackers = "|".join(sorted({name.split(".")[0] for name in registry}))
    named = re.findall(rf"`((?:{attackers})\.[a-z0-9_]+)`", text)
    for name in sorted(set(registry) - set(named)):
        yield f"docs/attacks.md does not name the attack {name}"
    for name in sorted(set(named) - set(registry)):
        yield f"docs/attacks.md names an attack that is not there: {name}"
    for name in sorted({name for name in named if named.count(name) > 1}):
        yield f"docs/attacks.md names {name} twice"
    for finding in REVIEW:
        if finding not in registry.values():
            yield f"no attack replays {finding} of the review"
    sources = "\n".join(source.read_text() for source in (root / "tests").rglob("*_test.cpp"))
    for suite, name in sorted(set(re.findall(r"`([A-Z]\w+)\.([A-Z]\w+)`", text))):
        if not re.search(rf"TEST(_F|_P)?\({suite}, {name}\)", sources):
            yield f"docs/attacks.md: no such test: {suite}.{name}"
    scripts = "\n".join(source.read_text() for source in (root / "tests").rglob("*_test.py"))
    for name in sorted(set(re.findall(r"`(test_\w+)`", text))):
        if f"def {name}(" not in scripts:
            yield f"docs/attacks.md: no such test: {name}"


def main():
    checks = {"links": check_links, "units": check_units, "commands": check_commands, "examples": check_examples, "tests": check_tests,
              "attacks": check_bench_attacks}
    if len(sys.argv) != 4 or sys.argv[1] not in checks:
        print(__doc__, file=sys.stderr)
        return 2
    problems = list(checks[sys.argv[1]](pathlib.Path(sys.argv[2]).resolve(), pathlib.Path(sys.argv[3]).resolve()))
    print("\n".join(problems) if problems else f"{sys.argv[1]}: fine")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
