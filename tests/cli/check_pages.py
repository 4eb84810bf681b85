#!/usr/bin/env python3
"""The manual pages and completions of the built programs, judged by man and by the shells themselves.

usage: check_pages.py FOLDER_OF_PROGRAMS
"""
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

PROGRAMS = ["nadir", "nadird", "nadir-candidates"]
BASH = r'''
source "$1"; shift
COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); COMPREPLY=()
function=$(complete -p -- "$1"); function=${function#*-F }; "${function%% *}"
printf '%s\n' "${COMPREPLY[@]}"
'''
# What is typed, and what must be among the answers. The last one is nonsense: nothing may be offered.
CASES = [(["nadir", "ca"], "cache"), (["nadir", "cache", ""], "build"), (["nadir", "cache", "build", "--tile-f"], "--tile-format"),
         (["nadir", "cache", "build", "--tile-format", ""], "webp"), (["nadir", "replay", "--pack"], "--package"),
         (["nadird", "--stat"], "--state"), (["nadir-candidates", "token", "cr"], "create"), (["nadir", "zzz"], None)]


def output(*args, **options):
    return subprocess.run(args, capture_output=True, text=True, check=True, **options).stdout


def options_of(program, *words):
    return re.findall(r"^\s+(--[a-z-]+)", output(program, *words, "--help"), re.M)


def commands_of(program):
    text = output(program, "--help")
    if "Commands:\n" not in text:
        return [[]]
    return [re.split(r"\s{2,}", line.strip())[0].split() for line in text.split("Commands:\n")[1].split("\n\n")[0].splitlines()]


def check_manual(programs, pages):
    for name in PROGRAMS:
        for words in commands_of(programs / name):
            page = pages / "man" / ("-".join([name, *words]) + (".1" if words else ".8"))
            text = page.read_text().replace("\\-", "-")
            missing = [option for option in options_of(programs / name, *words) if option not in text]
            if missing:
                yield f"{page.name} does not name {missing}"
    if shutil.which("groff") is None:
        print("NOT TESTED: manual pages as groff sees them: it is not installed")
        return
    for page in sorted((pages / "man").iterdir()):
        judged = subprocess.run(["groff", "-man", "-Tutf8", "-ww", "-z", str(page)], capture_output=True, text=True)
        if judged.returncode != 0 or judged.stderr:
            yield f"{page.name}: {judged.stderr}"


def check_completions(pages):
    folder = pages / "completions"
    for typed, wanted in CASES:
        answers = output("bash", "-c", BASH, "bash", str(folder / "bash" / typed[0]), *typed).split()
        if (wanted is None and answers) or (wanted is not None and wanted not in answers):
            yield f"bash: {typed}: {answers[:5]}, expected {wanted}"
    if shutil.which("fish"):
        for typed, wanted in CASES:
            line = " ".join(typed)
            said = output("fish", "-c", f"source {folder}/fish/{typed[0]}.fish; complete -C '{line}'", env={**os.environ, "HOME": str(pages)})
            answers = [answer.split("\t")[0] for answer in said.splitlines()]
            if (wanted is None and answers) or (wanted is not None and wanted not in answers):
                yield f"fish: {line}: {answers[:5]}, expected {wanted}"
    else:
        print("NOT TESTED: completions of fish: it is not installed")
    if shutil.which("zsh"):
        for name in PROGRAMS:
            judged = subprocess.run(["zsh", "-n", str(folder / "zsh" / f"_{name}")], capture_output=True, text=True)
            if judged.returncode != 0:
                yield f"zsh: {judged.stderr}"
    else:
        print("NOT TESTED: completions of zsh: it is not installed")


def main():
    programs = pathlib.Path(sys.argv[1]).resolve()
    with tempfile.TemporaryDirectory(prefix="nadir-pages.") as folder:
        pages = pathlib.Path(folder)
        for name in PROGRAMS:
            subprocess.run([programs / name, "--write-pages", folder], check=True)
        problems = [*check_manual(programs, pages), *check_completions(pages)]
    print("\n".join(problems) if problems else "pages: fine")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
