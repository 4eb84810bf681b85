#!/usr/bin/env python3
"""Each rule of check_layers.py catches a breach that is made on purpose."""
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
from check_layers import check  # noqa: E402


class Rules(unittest.TestCase):
    def violations(self, path, text, **more):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for name in ("libgeo/base", "tools", "runtime"):
                (root / name).mkdir(parents=True)
            for name, contents in {path: text, **more}.items():
                file = root / name
                file.parent.mkdir(parents=True, exist_ok=True)
                file.write_text(contents)
            return check(root)

    def test_downwards_is_allowed(self):
        self.assertEqual([], self.violations("libgeo/package/a.hpp", '#include "base/error.hpp"\n#include <vector>\n'))

    def test_upwards_is_caught(self):
        self.assertEqual(1, len(self.violations("libgeo/base/a.cpp", '#include "vision/camera_model.hpp"\n')))

    def test_a_program_is_caught(self):
        self.assertEqual(1, len(self.violations("libgeo/base/a.cpp", '#include "framework/command.hpp"\n')))

    def test_an_unknown_layer_is_caught(self):
        self.assertEqual(1, len(self.violations("libgeo/misc/a.cpp", "")))

    def test_gdal_outside_of_ground_is_caught(self):
        self.assertEqual(1, len(self.violations("libgeo/imagery/a.cpp", "#include <gdal_priv.h>\n")))
        self.assertEqual([], self.violations("libgeo/ground/a.cpp", "#include <gdal_priv.h>\n"))

    def test_curl_outside_of_sync_is_caught(self):
        self.assertEqual(1, len(self.violations("libgeo/ground/a.cpp", "#include <curl/curl.h>\n")))

    def test_heavy_headers_are_caught(self):
        for name in ("ceres/ceres.h", "gdal.h", "faiss/Index.h", "CLI/CLI.hpp", "nlohmann/json.hpp"):
            self.assertEqual(1, len(self.violations("tools/a.hpp", f"#include <{name}>\n")), name)
        self.assertEqual([], self.violations("tools/a.hpp", "#include <nlohmann/json_fwd.hpp>\n"))

    def test_the_aircraft_stays_off_the_ground(self):
        self.assertEqual(1, len(self.violations("runtime/a.cpp", '#include "ground/raster_source.hpp"\n')))

    def test_two_types_of_one_name_are_caught(self):
        one = "namespace nadir {\nclass Client final : public Base {\n};\n"
        self.assertEqual(1, len(self.violations("tools/a.hpp", one, **{"libgeo/base/b.hpp": "struct Client {\n  int a;\n};\n"})))
        self.assertEqual([], self.violations("tools/a.hpp", one, **{"libgeo/base/b.hpp": "struct Client;\nstruct Clients {\n"}))


if __name__ == "__main__":
    unittest.main()
