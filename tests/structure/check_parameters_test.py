#!/usr/bin/env python3
"""check_parameters.py reads the table as it is written, and catches what may not be."""
import contextlib
import io
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import check_parameters  # noqa: E402

TABLE = """// The numbers that decide.
#pragma once
namespace nadir {

// ---- correlation

inline constexpr double kShare = 0.6;  // of a template on valid map; chosen
inline constexpr int kDark = 2, kBright = 253;  // grey levels
// Two of a kind: [roc].
inline constexpr double kOne_m = 1.5;
inline constexpr double kTwo_m =
    2.5;

struct GateLimits {
  double clear_ratio = 0.45;  // below: hardly any other place is possible;
                              // [roc]
};
inline constexpr std::array<Round, 2> kRounds{{{8, 3.5}, {6, 2.5}}};  // chosen

}  // namespace nadir
"""


class Parameters(unittest.TestCase):
    def run_on(self, files, *arguments):
        with tempfile.TemporaryDirectory() as folder:
            root = pathlib.Path(folder)
            for name in ("libgeo/vision", "libgeo/estimation", "docs"):
                (root / name).mkdir(parents=True)
            for name, text in files.items():
                (root / name).write_text(text)
            output = io.StringIO()
            before, sys.argv = sys.argv, ["check", folder, *arguments]
            try:
                with contextlib.redirect_stdout(output):
                    first = check_parameters.main()
                    again = None
                    if "--write" in arguments:
                        sys.argv = ["check", folder]
                        again = check_parameters.main()
            finally:
                sys.argv = before
            page = root / "docs/parameters.md"
            return first, again, output.getvalue(), page.read_text() if page.exists() else ""

    def test_every_form_of_a_number(self):
        rows = dict((name, (value, origin)) for _, found in check_parameters.read_table(TABLE) for name, value, origin in found)
        self.assertEqual(("0.6", "of a template on valid map; chosen"), rows["kShare"])
        self.assertEqual(("2", "grey levels"), rows["kDark"])
        self.assertEqual(("253", "grey levels"), rows["kBright"])
        self.assertEqual(("1.5", "Two of a kind: [roc]."), rows["kOne_m"])
        self.assertEqual(("2.5", "Two of a kind: [roc]."), rows["kTwo_m"])
        self.assertEqual(("0.45", "below: hardly any other place is possible; [roc]"), rows["clear_ratio"])

    def test_a_struct_ends_where_it_ends(self):
        names = {title: [name for name, _, _ in found] for title, found in check_parameters.read_table(TABLE)}
        self.assertEqual({"correlation": ["kShare", "kDark", "kBright", "kOne_m", "kTwo_m", "kRounds"], "GateLimits": ["clear_ratio"]}, names)

    def test_braces_stay_in_pairs(self):
        rows = dict((name, value) for _, found in check_parameters.read_table(TABLE) for name, value, _ in found)
        self.assertEqual("{8, 3.5}, {6, 2.5}", rows["kRounds"])

    def test_a_number_that_is_not_read_is_no_secret(self):
        table = TABLE.replace("struct GateLimits", "inline constexpr Rounds kOthers{{8, 6, 3.5}};  // chosen\n\nstruct GateLimits")
        first, _, output, _ = self.run_on({check_parameters.TABLE: table}, "--write")
        self.assertEqual(1, first)
        self.assertIn("kOthers is not read", output)

    def test_the_page_follows_the_table(self):
        first, again, _, page = self.run_on({check_parameters.TABLE: TABLE}, "--write")
        self.assertEqual((0, 0), (first, again))
        self.assertIn("| `kShare` | 0.6 | of a template on valid map; chosen |", page)
        self.assertEqual(1, self.run_on({check_parameters.TABLE: TABLE, check_parameters.PAGE: page.replace("0.6", "0.7")})[0])

    def test_a_number_elsewhere_is_caught(self):
        for line, count in (("const double x = 0.37;", 1), ("y = z * 1.2e-4F;", 1), ("a = 0.5 * b + 2.0;  // 0.37", 0), ('f("0.37");', 0),
                            ("v2.size()", 0)):
            _, _, output, _ = self.run_on({check_parameters.TABLE: TABLE, "libgeo/estimation/a.cpp": line + "\n"}, "--write")
            self.assertEqual(count, output.splitlines()[0].count("tuned"), line)

    def test_a_number_without_origin_is_caught(self):
        first, _, output, _ = self.run_on({check_parameters.TABLE: "inline constexpr double kNew = 7;\n"}, "--write")
        self.assertEqual(1, first)
        self.assertIn("kNew has no origin", output)


if __name__ == "__main__":
    unittest.main()
