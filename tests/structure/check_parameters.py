#!/usr/bin/env python3
"""Holds libgeo/vision and libgeo/estimation to their one table of numbers, and docs/parameters.md to the table.

usage: check_parameters.py PROJECT_ROOT [--write]

Fails when a file of these folders other than localizer_parameters.hpp and the fitted tables of looks holds a fractional literal that is not mathematics,
when a number of the table has no origin or a type that is not read here, so that the page would lack it, and when docs/parameters.md does not match the table.
--write writes the page anew.
"""
import pathlib
import re
import sys

TABLE = "libgeo/vision/localizer_parameters.hpp"
FITTED = ("libgeo/estimation/look_likelihood_table.hpp",  # written by a program; a test fits it again
          "libgeo/estimation/second_likelihood_table.hpp")  # likewise; a test knows its numbers by their digest
FOLDERS = ("libgeo/vision", "libgeo/estimation")
PAGE = "docs/parameters.md"
# Halves and quarters, whole numbers, powers of ten between units: mathematics, not decisions.
MATHEMATICS = {0.0, 0.25, 0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 12.0, 90.0, 180.0, 255.0, 360.0, 1e3, 1e6, 1e7, 1e9, 1e-3, 1e-6, 1e-9}
LITERAL = re.compile(r"(?<![\w.])(\d+\.\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?|\d+[eE][+-]?\d+)[fF]?(?![\w.])")
STRINGS_AND_COMMENTS = re.compile(r'"(?:[^"\\\n]|\\.)*"|//[^\n]*')
NUMBER = re.compile(r"^\s*(?:inline constexpr |constexpr )?(?:double|float|int|std::size_t|std::uint\d+_t|std::int\d+_t|bool|std::array<[^=]*>) "
                    r"(\w+(?: = [^;]*|\{[^;]*\}));\s*(?://\s*(.*))?$")

HEAD = """# Parameters of the localizer

Every number of matching and estimation that was tuned, chosen or measured. `tests/structure/check_parameters.py . --write`
makes this table from [`localizer_parameters.hpp`](../libgeo/vision/localizer_parameters.hpp). A test compares the two, and
rejects other fractional literals in `libgeo/vision` and `libgeo/estimation` that are not mathematics. A name ends with the unit;
without one the number is a count or a ratio. [safety N] is segment N of the [Monte Carlo](safety.md), [looks] the [looks with known answers](look-likelihood.md#looks-with-known-answers);
other names in brackets are parts of [`./run bench`](benchmarks.md).
"""


def stray_literals(path):
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
        for match in LITERAL.finditer(STRINGS_AND_COMMENTS.sub("", line)):
            if float(match.group(1)) not in MATHEMATICS:
                yield number, match.group(0)


def unwrapped(value):
    """Without the braces around all of it."""
    while value.startswith("{") and value.endswith("}"):
        depth, inside = 0, True
        for letter in value[:-1]:
            depth += (letter == "{") - (letter == "}")
            inside = inside and depth > 0
        if not inside:
            break
        value = value[1:-1].strip()
    return value


def declarations(value):
    """"kA = 1, kB = 2" as (name, value) pairs; commas within braces and parentheses do not part."""
    parts, depth, start = [], 0, 0
    for at, letter in enumerate(value):
        depth += letter in "{(<"
        depth -= letter in "})>"
        if letter == "," and depth == 0:
            parts.append(value[start:at])
            start = at + 1
    parts.append(value[start:])
    for part in parts:
        match = re.match(r"\s*(\w+)\s*=?\s*(.*)", part, re.DOTALL)
        if match:
            yield match.group(1), unwrapped(match.group(2).strip())


def joined(lines):
    """Declarations that were broken over lines as one line each, with their trailing comments."""
    result = []
    for line in lines:
        previous = result[-1] if result else ""
        code = previous.split("//")[0].rstrip()
        if code and not previous.lstrip().startswith("//") and not code.endswith((";", "{", "}", ":")) and not code.startswith("#"):
            result[-1] = previous.rstrip() + " " + line.strip()
        else:
            result.append(line)
    return result


def read_table(text):
    """[(section, [(name, value, origin)])]. The origin is the comment behind the number and below it, or else the one above it."""
    sections = [("", [])]
    rows = around = sections[0][1]  # of the section that is read, and of the one around a struct
    above, rows_above = [], False
    for line in joined(text.splitlines()):
        heading = re.match(r"\s*// ---- (.*)", line)
        named = re.match(r"\s*(?:struct|namespace) (\w+) \{", line)
        if heading or named:
            title = heading.group(1) if heading else named.group(1)
            if title not in ("nadir", "parameters"):
                rows = []
                sections.append((title, rows))
            if heading or line.lstrip().startswith("namespace"):
                above, around = [], rows
            continue
        if line.startswith("};"):
            rows, above, rows_above = around, [], False
            continue
        comment = re.match(r"\s*// ?(.*)", line)
        number = NUMBER.match(line)
        if number:
            origin = number.group(2) or " ".join(above)
            for name, value in declarations(number.group(1)):
                rows.append((name, value, origin))
            rows_above = True
        elif comment and rows_above and rows and len(line) - len(line.lstrip()) > 20:
            name, value, origin = rows[-1]
            rows[-1] = (name, value, f"{origin} {comment.group(1)}")
        elif comment:
            above = above + [comment.group(1)] if not rows_above else [comment.group(1)]
            rows_above = False
        elif not line.strip():
            above, rows_above = [], False
    return [(title, found) for title, found in sections if found]


def page(sections):
    lines = [HEAD]
    for title, rows in sections:
        lines += [f"## {title[:1].upper()}{title[1:]}" if title else "## General", "", "| name | value | origin |", "|---|---|---|"]
        lines += [f"| `{name}` | {value} | {origin.replace('|', chr(92) + '|')} |" for name, value, origin in rows]
        lines.append("")
    return "\n".join(lines)


def main():
    arguments = [argument for argument in sys.argv[1:] if argument != "--write"]
    if len(arguments) != 1:
        print(__doc__, file=sys.stderr)
        return 2
    root = pathlib.Path(arguments[0])
    found = []
    for folder in FOLDERS:
        for path in sorted((root / folder).glob("*.[ch]pp")):
            if path.relative_to(root).as_posix() not in (TABLE, *FITTED):
                found += [f"{path.relative_to(root)}:{number}: {literal} is a tuned number: it belongs in {TABLE}"
                          for number, literal in stray_literals(path)]
    table = (root / TABLE).read_text(encoding="utf-8")
    sections = read_table(table)
    on_page = {name for _, rows in sections for name, _, _ in rows}
    found += [f"{TABLE}: {name} is not read: it needs a type that {pathlib.Path(__file__).name} knows"
              for name in re.findall(r"^inline constexpr [^=;{]*?(\w+)\s*[={]", table, re.MULTILINE) if name not in on_page]
    if not sections:
        found.append(f"{TABLE} holds no numbers")
    found += [f"{TABLE}: {name} has no origin" for _, rows in sections for name, _, origin in rows if not origin]
    expected = page(sections)
    if "--write" in sys.argv:
        (root / PAGE).write_text(expected, encoding="utf-8")
    elif not (root / PAGE).exists() or (root / PAGE).read_text(encoding="utf-8") != expected:
        found.append(f"{PAGE} does not match {TABLE}; to do: tests/structure/check_parameters.py . --write")
    count = sum(len(rows) for _, rows in sections)
    print("\n".join(found) if found else f"parameters: {count} numbers, all of them in the table and on the page")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
