#!/usr/bin/env python3
"""Each rule of check_layers.py catches a breach that is made on purpose."""
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import check_layers  # noqa: E402


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
            return check_layers.check(root)[0]

    def test_an_allowed_edge(self):
        self.assertEqual([], self.violations("libgeo/package/a.hpp", '#include "base/error.hpp"\n#include <vector>\n'))

    def test_the_drawing_names_every_folder(self):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for name in ("base", "vision"):
                (root / "libgeo" / name).mkdir(parents=True)
            drawing = root / "drawing.svg"
            drawing.write_text("<text>base</text><text>visions</text>")
            self.assertEqual(["vision"], check_layers.missing_in(drawing, root))

    def test_a_library_includes_one_above_it(self):
        self.assertEqual(1, len(self.violations("libgeo/base/a.cpp", '#include "vision/camera.hpp"\n')))

    def test_a_library_includes_a_program(self):
        self.assertEqual(1, len(self.violations("libgeo/base/a.cpp", '#include "commands/commands.hpp"\n')))
        self.assertEqual(1, len(self.violations("libgeo/mavlink/a.cpp", '#include "service/clock.hpp"\n')))

    def test_programs_include_each_other(self):
        self.assertEqual(1, len(self.violations("tools/commands/replay.cpp", '#include "service/clock.hpp"\n')))
        self.assertEqual(1, len(self.violations("runtime/flight/a.cpp", '#include "commands/commands.hpp"\n')))

    def test_files_deeper_down_belong_to_the_folder(self):
        self.assertEqual(1, len(self.violations("tools/commands/cache/a.cpp", '#include "flight/flight_service.hpp"\n')))
        self.assertEqual([], self.violations("tools/commands/cache/a.cpp", '#include "package/manifest.hpp"\n'))

    def test_an_unknown_folder(self):
        self.assertEqual(1, len(self.violations("libgeo/misc/a.cpp", "")))

    def test_the_aircraft_carries_nothing_of_the_ground(self):
        for name in ("raster/raster_source.hpp", "upload/outbox.hpp", "simulation/world.hpp", "catalogue/catalogue.hpp"):
            self.assertEqual(1, len(self.violations("runtime/flight/a.cpp", f'#include "{name}"\n')), name)

    def test_gdal_outside_of_the_ground(self):
        self.assertEqual(1, len(self.violations("libgeo/imagery/a.cpp", "#include <gdal_priv.h>\n")))
        self.assertEqual([], self.violations("libgeo/raster/a.cpp", "#include <gdal_priv.h>\n"))

    def test_curl_outside_of_upload(self):
        self.assertEqual(1, len(self.violations("libgeo/raster/a.cpp", "#include <curl/curl.h>\n")))

    def test_heavy_headers(self):
        for name in ("ceres/ceres.h", "gdal.h", "faiss/Index.h", "CLI/CLI.hpp", "nlohmann/json.hpp", "boost/beast/core.hpp"):
            self.assertTrue(self.violations("tools/commands/a.hpp", f"#include <{name}>\n"), name)
        self.assertEqual([], self.violations("tools/commands/a.hpp", "#include <nlohmann/json_fwd.hpp>\n"))

    def test_a_function_that_rounds_by_processor(self):
        self.assertEqual(1, len(self.violations("libgeo/geodesy/a.cpp", "double d = std::hypot(x, y);\n")))
        self.assertEqual([], self.violations("libgeo/geodesy/a.cpp", "double d = hypotenuse(x, y);  // not std::hypot\n"))

    def test_two_types_of_one_name(self):
        one = "namespace nadir {\nclass Client final : public Base {\n};\n"
        path = "tools/commands/a.hpp"
        self.assertEqual(1, len(self.violations(path, one, **{"libgeo/base/b.hpp": "struct Client {\n  int a;\n};\n"})))
        self.assertEqual([], self.violations(path, one, **{"libgeo/base/b.hpp": "struct Client;\nstruct Clients {\n"}))

    def test_the_permissions_have_no_cycle(self):
        self.assertEqual([], check_layers.cycles())
        allowed = check_layers.ALLOWED
        try:
            check_layers.ALLOWED = {**allowed, "base": "estimation"}
            self.assertIn("base", check_layers.cycles())
        finally:
            check_layers.ALLOWED = allowed


if __name__ == "__main__":
    unittest.main()
