#!/usr/bin/env python3
"""A suite that skips a case must show: it ends with 77, which ctest knows as skipped; one that tests everything with 0.

usage: check_skips.py TEST_IMAGERY
"""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile


def run(cases, **environment):
    return subprocess.run([sys.argv[1], "--gtest_filter=" + cases], capture_output=True, text=True, check=False,
                          env={**os.environ, **environment})


with tempfile.TemporaryDirectory() as folder:  # a PATH without GDAL's tools
    (pathlib.Path(folder) / "bash").symlink_to(shutil.which("bash"))
    skipped = run("Codecs.GdalReadsTheSamePixels:Codecs.ReadsFiles", PATH=folder)
whole = run("Codecs.ReadsFiles")
if skipped.returncode != 77 or "NOT TESTED: gdal_translate" not in skipped.stdout or whole.returncode != 0:
    sys.exit(f"{skipped.returncode}, expected 77; {whole.returncode}, expected 0\n{skipped.stdout}{skipped.stderr}{whole.stdout}")
