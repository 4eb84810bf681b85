"""What happened: track.csv, a row every tenth of a second, and summary.json with the events and the figures."""
import csv
import json
import os

FIELDS = ["time_s", "unix_us", "lat_deg", "lon_deg", "altitude_m", "estimated_lat_deg", "estimated_lon_deg", "deviation_m",
          "filter_error_m", "filter_sigma_m", "source", "given_fix_type", "given_error_m", "given_accuracy_m", "given_age_s", "given_lat_deg", "given_lon_deg",
          "own_lat_deg", "own_lon_deg"]


class FlightLog:
    def __init__(self, folder=None, echo=None):
        """folder: is made; None keeps everything in memory. echo: called with a line for every event."""
        self.events, self.rows, self.verdicts = [], 0, {}
        self.echo = echo
        self.folder = folder
        self.file = None
        if folder is not None:
            os.makedirs(folder, exist_ok=True)
            self.file = open(os.path.join(folder, "track.csv"), "w", newline="", encoding="utf-8")
            self.writer = csv.DictWriter(self.file, FIELDS)
            self.writer.writeheader()

    def event(self, time_s, kind, **facts):
        self.events.append({"time_s": round(time_s, 3), "kind": kind, **facts})
        if self.echo is not None:
            self.echo(f"{time_s:8.2f} s  {kind:12}" + "  ".join(f"{key}={value}" for key, value in facts.items()))

    def verdict(self, word):
        self.verdicts[word] = self.verdicts.get(word, 0) + 1

    def row(self, values):
        self.rows += 1
        if self.file is not None:
            self.writer.writerow({key: f"{value:.9f}" if key.endswith("_deg") and value != "" else f"{value:.3f}"
                                  if isinstance(value, float) else value for key, value in values.items()})

    def close(self, summary):
        """Writes summary.json under its final name when it is whole."""
        if self.file is None:
            return
        self.file.close()
        path = os.path.join(self.folder, "summary.json")
        with open(path + ".tmp", "w", encoding="utf-8") as file:
            json.dump({**summary, "gps_input": self.verdicts, "events": self.events}, file, indent=1)
        os.replace(path + ".tmp", path)
