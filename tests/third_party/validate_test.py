"""Other people's tile sets, intact and damaged: nadir cache validate finds what is wrong, all of it and nothing else.
Everything is made here by gdal-bin and SQLite."""
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

from damages import DAMAGES
from tile_sets import TileSets

NADIR = sys.argv[1]


def validate(path, mission):
    """The findings, but for notes: GDAL promises overviews in `minzoom` that nobody asked it for."""
    result = subprocess.run([NADIR, "cache", "validate", str(path), "--mission", str(mission), "--json"],
                            stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=60)
    assert result.returncode in (0, 1), f"{path.name}: exit code {result.returncode}\n{result.stderr}"
    findings = json.loads(result.stdout)["findings"]
    assert (result.returncode == 1) == any(f["severity"] == "refuse" for f in findings)
    return [f for f in findings if f["severity"] != "note"]


class ThirdParty(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory(prefix="nadir-third.")
        cls.folder = pathlib.Path(cls.temporary.name)
        cls.sets = TileSets(cls.folder)

    @classmethod
    def tearDownClass(cls):
        cls.temporary.cleanup()

    def test_intact_sets_are_accepted(self):
        for name, path in self.sets.intact().items():
            with self.subTest(name):
                self.assertEqual([], validate(path, self.sets.mission))

    def test_each_damage_is_named(self):
        for number, (name, container, make, codes) in enumerate(DAMAGES):
            with self.subTest(name):
                path = self.folder / f"{number}.{'tif' if container == 'cog' else 'mbtiles'}"
                make(self.sets, path)
                findings = validate(path, self.sets.mission)
                self.assertEqual(codes, {f["code"] for f in findings}, json.dumps(findings, indent=1)[:4000])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1])
