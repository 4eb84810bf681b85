#!/usr/bin/env python3
"""Functions in anonymous namespaces that would hide one that a header declares.

usage: check_hidden_names.py PROJECT

The sources of a folder are compiled together (NADIR_UNITY). In them such a function is found before one of the same name in
`nadir`, by every source that comes after it: it is called instead, and the compiler says nothing where the parameters are the
same. Exit codes: 0 none, 1 some.
"""
import collections
import pathlib
import re
import sys

FOLDERS = ("libgeo", "runtime", "tools")
# From the first column: a type, a name, parameters (a level of brackets in them), and the end of a declaration or the body.
FUNCTION = re.compile(r"^(?!return\b|using\b|namespace\b|class\b|struct\b|else\b|static_assert)[A-Za-z\[][^\n(=;\"]*?[ &*>](\w+)"
                      r"\(((?:[^()]|\([^()]*\))*)\)\s*(?:const)?\s*(?:noexcept)?\s*[;{]", re.MULTILINE)
ANONYMOUS = re.compile(r"^namespace \{\n(.*?)^\}  // namespace$", re.MULTILINE | re.DOTALL)


def parameter_types(parameters):
    """Without names, defaults, const and references: what a call does not tell apart."""
    types, depth = [""], 0
    for character in re.sub(r"//[^\n]*|\s+", " ", parameters).strip():
        depth += (character in "<({") - (character in ">)}")
        if character == "," and depth == 0:
            types.append("")
        else:
            types[-1] += character
    bare = [re.sub(r"\bconst\b|&|std::", "", text.split("=")[0]).strip() for text in types]
    return tuple(re.sub(r"(?<=[\w>\]*])\s+\w+$", "", text).replace(" ", "") for text in bare)


def functions(text):
    return {(match.group(1), parameter_types(match.group(2))) for match in FUNCTION.finditer(text)}


def hidden(project):
    """(name, the source that hides it, the headers that declare it), ordered."""
    declared, own = collections.defaultdict(set), collections.defaultdict(set)
    for path in sorted(path for folder in FOLDERS for path in (project / folder).rglob("*.[ch]pp")):
        text, name = path.read_text(), str(path.relative_to(project))
        if path.suffix == ".hpp":
            for function in functions(text):
                declared[function].add(name)
        else:
            for part in ANONYMOUS.finditer(text):
                for function in functions(part.group(1)):
                    own[function].add(name)
    return sorted((function[0], source, sorted(declared[function])) for function, sources in own.items() if function in declared
                  for source in sources)


def main():
    found = hidden(pathlib.Path(sys.argv[1]))
    for name, source, headers in found:
        print(f"{source}: {name} in an anonymous namespace hides that of {', '.join(headers)} from the sources after it; "
              "to do: give it another name, or use that one")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
