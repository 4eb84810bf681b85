#!/usr/bin/env python3
"""Real photos against independent satellite imagery; skipped without the data set."""
import csv
import json

from support import EndToEnd, data_set, main, run


class Fengyuan(EndToEnd):
    def test_photos_are_localized_against_satellite_imagery(self):
        data = data_set("fengyuan")
        self.keys()
        self.good("cache", "build", "--mission", data / "mission.yaml", "--imagery", data / "map.tif", "--key",
                  self.folder / "signer.key.pem", "--out", self.folder / "package")
        result = self.good("replay", "--package", self.folder / "package", "--trust", self.folder / "root.json", "--at",
                           "2024-11-05", "--frames", data / "frames", "--telemetry", data / "telemetry.csv", "--camera",
                           data / "camera.yaml", "--start", "120.720208,24.262133", "--truth", data / "truth.csv", "--out",
                           self.folder / "out", "--json", timeout=600)
        summary = json.loads(result.stdout)
        self.assertGreaterEqual(summary["localized_share"], 0.9)
        self.assertEqual(0, summary["wrong_anchors"])
        self.assertLessEqual(summary["median_m"], 15)

    def test_wrong_facts_are_named(self):
        """The same photos with heights in feet, and with negated headings: nothing is localized, and the cause is said."""
        data = data_set("fengyuan")
        self.keys()
        self.good("cache", "build", "--mission", data / "mission.yaml", "--imagery", data / "map.tif", "--key",
                  self.folder / "signer.key.pem", "--out", self.folder / "package")
        for name, column, factor, cause, says in (("feet", "agl_m", 3.2808, "height", "are the heights in feet"),
                                                  ("negated", "heading_deg", -1, "heading", "counter-clockwise (negated)")):
            rows = list(csv.DictReader((data / "telemetry.csv").read_text().splitlines()))[:8]
            telemetry = self.folder / f"{name}.csv"
            with telemetry.open("w", newline="") as file:
                table = csv.DictWriter(file, rows[0].keys())
                table.writeheader()
                table.writerows({**row, column: float(row[column]) * factor} for row in rows)
            result = run("replay", "--package", self.folder / "package", "--trust", self.folder / "root.json", "--at", "2024-11-05", "--frames",
                         data / "frames", "--telemetry", telemetry, "--camera", data / "camera.yaml", "--start", "120.720208,24.262133", "--out",
                         self.folder / name, "--json", timeout=600)
            self.assertEqual(1, result.returncode, result.stderr)
            self.assertEqual(cause, json.loads(result.stdout)["diagnosis"]["cause"], result.stderr)
            self.assertIn(says, result.stderr)


if __name__ == "__main__":
    data_set("fengyuan")
    main()
