#!/usr/bin/env python3
"""Real photos against independent satellite imagery; skipped without the data set."""
import json

from support import EndToEnd, data_set, main


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


if __name__ == "__main__":
    data_set("fengyuan")
    main()
