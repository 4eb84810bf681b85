"""nadird killed repeatedly in flight, and restarted as systemd does."""
import statistics
import time

from .evidence import Finding, fresh_fixes, judged_right, readable
from .flight import Flight, Setup

EVERY_S, RESTART_AFTER_S, BACK_WITHIN_S = 30, 0.2, 5.0
DENIED_S = 20


def fly(args, inputs, run):
    """The findings."""
    setup = Setup(inputs, run, args.nadir, args.nadird, [f"{DENIED_S}:gps-denied"], args.kill_minutes + 0.4, signed=True)
    killed = []  # seconds since 1970
    with Flight(setup) as flight:
        flight.start()
        next_s = flight.begun + EVERY_S
        while flight.autopilot.running():
            flight.must_be_running()
            if time.monotonic() < next_s or time.monotonic() > flight.begun + args.kill_minutes * 60 + 5:
                time.sleep(0.05)
                continue
            next_s += EVERY_S
            killed.append(time.time())
            flight.service.process.kill()
            flight.service.end()
            time.sleep(RESTART_AFTER_S)
            flight.start_service(f"service-{len(killed)}")
            flight.watch.program = flight.service
        summary, _ = flight.finish()
    return judge(summary, setup.rows(), killed, args.nadir, flight.record)


def back_after_s(rows, killed_at):
    """From the kill to the first fix of the next service, and that fix."""
    gone = False
    for row in rows:
        after_s = float(row["unix_us"]) * 1e-6 - killed_at
        if after_s <= 0:
            continue
        age_s = float(row["given_age_s"] or 99)
        gone = gone or age_s > 0.25
        if gone and age_s < 0.15 and int(row["given_fix_type"]) >= 3:
            return after_s, row
    return None, None


def judge(summary, rows, killed, nadir, record):
    fault = f"kill -9, {len(killed)} times"
    back = [back_after_s(rows, at) for at in killed]
    times = [seconds for seconds, _ in back if seconds is not None]
    within = sum(seconds <= BACK_WITHIN_S for seconds in times)
    firsts = [float(row["given_error_m"]) for _, row in back if row is not None]
    findings = [
        Finding(fault, f"a position again within {BACK_WITHIN_S:.0f} s", "never" if not times else
                f"{within} of {len(killed)}: median {statistics.median(times):.1f} s, longest {max(times):.1f} s; first fix "
                f"at most {max(firsts):.1f} m off", within == len(killed) > 0),
        judged_right(fault, rows),
        Finding(fault, "no reset of the autopilot's filter, no frame refused",
                f"{summary['resets_by_gps_input']} resets, {summary['link']['refused']} refused",
                summary["resets_by_gps_input"] == 0 and summary["link"]["refused"] == 0),
        Finding(fault, "the true track within 50 m of the plan", f"at most {summary['deviation_m']['max']:.1f} m",
                summary["deviation_m"]["max"] <= 50)]
    if len(fresh_fixes(rows)) == 0:
        findings.append(Finding(fault, "fixes", "none", False))
    return findings + [readable(fault, nadir, record)]
