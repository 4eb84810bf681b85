#!/usr/bin/env python3
"""Hours of simulated flight at many times real time: nadird with a clock that goes as fast (tests/bench/fast_nadird.cpp),
small frames, the API polled and its events read. Memory, file handles and threads must not grow; the exit code is 1 when
they do. docs/closed-loop.md.
"""
import argparse
import os
import pathlib
import statistics
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parent))
from loop import harness
from loop.bad_readers import BadReaders
from loop.flight import Flight, Setup
from loop.inputs import Inputs

SAMPLE_S = 2
SETTLED = 0.15  # of the flight: until then all ground has been flown over, and caches are full
GROWTH_PERCENT = 5
DENIED_S, READERS = 120, 4


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--hours", type=float, default=2)
    parser.add_argument("--speed", type=float, default=8, help="times real time")
    harness.add_words(parser, width=480, nadird="bench_fast_nadird")
    return parser.parse_args()


def sample(pid):
    """(MB, file handles, threads)"""
    fields = pathlib.Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()
    return (int(fields[1]) * os.sysconf("SC_PAGESIZE") / 1e6, len(os.listdir(f"/proc/{pid}/fd")),
            len(os.listdir(f"/proc/{pid}/task")))


def fly(args, inputs, run):
    """(summary, nadird's own summary, samples)"""
    setup = Setup(inputs, run, args.nadir, args.nadird, [f"{DENIED_S}:gps-denied"], args.hours * 60, speed=args.speed,
                  environment={"NADIR_SOAK_SPEED": f"{args.speed:g}"})
    samples = []
    with Flight(setup) as flight, BadReaders(READERS) as readers:
        flight.start()
        readers.begin(flight.api_port)
        while flight.autopilot.running():
            flight.must_be_running()
            samples.append(sample(flight.service.pid))
            time.sleep(SAMPLE_S)
        summary, service = flight.finish()
    return summary, service, samples


def growth(samples, column):
    """From the first tenth of the settled samples to the last one, by their medians."""
    settled = [row[column] for row in samples[int(len(samples) * SETTLED):]]
    tenth = max(1, len(settled) // 10)
    return statistics.median(settled[:tenth]), statistics.median(settled[-tenth:])


def main():
    args = arguments()
    with harness.output(args, "soak") as out:
        inputs = Inputs(harness.inputs_folder(args, out), args.nadir, width=args.width)
        begun = time.monotonic()
        summary, service, samples = fly(args, inputs, harness.fresh(out / "soak"))
        took = time.monotonic() - begun
    (mb, mb_end), (files, files_end), (threads, threads_end) = (growth(samples, column) for column in range(3))
    good = mb_end <= mb * (1 + GROWTH_PERCENT / 100) and files_end <= files and threads_end <= threads
    print(f"flown          {summary['duration_s'] / 3600:.2f} h in {took / 60:.1f} minutes, {service['frames']} frames, "
          f"{service['dropped']} dropped")
    print(f"memory         {mb:.1f} MB → {mb_end:.1f} MB ({100 * (mb_end / mb - 1):+.1f} %), at most "
          f"{max(row[0] for row in samples):.1f} MB")
    print(f"file handles   {files:.0f} → {files_end:.0f}")
    print(f"threads        {threads:.0f} → {threads_end:.0f}")
    deviation, fix = summary["deviation_m"], summary["fix_error_m"]
    print(f"true track     median {deviation['median']:.1f}, max {deviation['max']:.1f} m from the plan; fixes at most "
          f"{fix['max']:.1f} m off")
    print("as it should be" if good else "GROWS")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
