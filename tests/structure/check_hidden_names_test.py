#!/usr/bin/env python3
"""check_hidden_names.py finds what it is there for, and leaves overloads alone."""
import pathlib
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import check_hidden_names  # noqa: E402

HEADER = """namespace nadir {
std::string csv_cell(const std::string& text);
inline double rounded(double value, double steps = 1000) { return value * steps; }
}  // namespace nadir
"""
SOURCE = "namespace nadir {{\nnamespace {{\n\n{}\n\n}}  // namespace\n}}  // namespace nadir\n"


class HiddenNames(unittest.TestCase):
    def found(self, body):
        with tempfile.TemporaryDirectory() as folder:
            project = pathlib.Path(folder)
            for name, text in (("libgeo/replay/track_files.hpp", HEADER), ("tools/commands/report.cpp", SOURCE.format(body))):
                (project / name).parent.mkdir(parents=True)
                (project / name).write_text(text)
            return check_hidden_names.hidden(project)

    def test_the_same_parameters(self):
        expected = [("csv_cell", "tools/commands/report.cpp", ["libgeo/replay/track_files.hpp"])]
        self.assertEqual(expected, self.found("std::string csv_cell(const std::string& cell) {\n  return cell;\n}"))
        self.assertEqual(expected, self.found("std::string csv_cell(std::string cell) { return cell; }"))
        [(name, _, _)] = self.found("std::int64_t rounded(double value, double unit) { return std::llround(value / unit); }")
        self.assertEqual("rounded", name)

    def test_others(self):
        self.assertEqual([], self.found("std::string csv_cell(const Cell& cell) { return {}; }"))
        self.assertEqual([], self.found("std::string csv_cell_of(const std::string& cell) { return cell; }"))
        self.assertEqual([], self.found("double twice(double value) {\n  return rounded(value, 2);\n}"))


if __name__ == "__main__":
    unittest.main()
