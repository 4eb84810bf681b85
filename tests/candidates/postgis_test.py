#!/usr/bin/env python3
"""Tests of the catalogue from inside, in a real PostGIS server that this test starts; exit code 77 where there is none.

usage: postgis_test.py TEST_CANDIDATES FILTER
"""
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent.parent / "support"))
from postgres import Server  # noqa: E402

PROGRAM, FILTER = sys.argv[1:3]
server = Server()
try:
    server.start()
    server.psql("postgres", "CREATE DATABASE packs")
    server.psql("packs", "CREATE EXTENSION postgis")
    result = subprocess.run([PROGRAM, f"--gtest_filter={FILTER}"],
                            env={**server.env, "NADIR_TEST_CATALOGUE": "PG:dbname=packs"})
finally:
    server.remove()
sys.exit(result.returncode)
