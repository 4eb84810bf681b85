#!/usr/bin/env python3
"""A build shared by two nodes of a real Slurm, through the scripts of docs/scale.md: an array of shards and the merge that
depends on it. A node is killed while it works, slurmd, slurmstepd and nadir at once; its shard is requeued on the other
node, and the package is that of one machine. So are its matchability map and place index.

The controller, the nodes and munge run from a folder of their own, on free ports. Ends with 77 where Slurm is not installed."""
import filecmp
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import sys
import time

from support import CAMERA, NADIR, EndToEnd, main

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROGRAMS = ["slurmctld", "slurmd", "munged", "sbatch", "squeue", "scontrol"]
PATH = f"{pathlib.Path(NADIR).resolve().parent}:{os.environ['PATH']}:/usr/sbin:/sbin"
SHARDS = 4

CONFIGURATION = """ClusterName=nadir
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge.socket
CredType=cred/munge
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
SchedulerType=sched/builtin
SlurmdParameters=config_overrides
SlurmdTimeout=5
KillWait=1
NodeName=n1 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[1]} CPUs=1
NodeName=n2 NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[2]} CPUs=1
PartitionName=all Nodes=n1,n2 Default=YES MaxTime=INFINITE State=UP
"""


def free_ports(count):
    sockets = [socket.socket() for _ in range(count)]
    for one in sockets:
        one.bind(("127.0.0.1", 0))
    ports = [one.getsockname()[1] for one in sockets]
    for one in sockets:
        one.close()
    return ports


def process_status(pid):
    """{"Name": …, "State": …, "PPid": …} of a process; empty when it is gone."""
    try:
        text = pathlib.Path(f"/proc/{pid}/status").read_text()
    except OSError:
        return {}
    return dict(line.split(":\t", 1) for line in text.splitlines() if ":\t" in line)


def environment_of(pid):
    try:
        entries = pathlib.Path(f"/proc/{pid}/environ").read_bytes().split(b"\0")
    except OSError:
        return {}
    return dict(entry.decode(errors="replace").split("=", 1) for entry in entries if b"=" in entry)


class Cluster:
    """Two nodes on this machine."""

    def __init__(self, folder):
        self.folder = folder
        self.processes = {}
        (folder / "state").mkdir()
        key = folder / "munge.key"
        key.write_bytes(os.urandom(64))
        key.chmod(0o600)
        user = subprocess.run(["id", "-un"], capture_output=True, text=True, check=True).stdout.strip()
        (folder / "slurm.conf").write_text(CONFIGURATION.format(folder=folder, host=socket.gethostname(), user=user,
                                                                ports=free_ports(3)))
        self.environment = {**os.environ, "PATH": PATH, "SLURM_CONF": str(folder / "slurm.conf")}
        self.start("munged", "munged", "--foreground", "--force", f"--socket={folder}/munge.socket", f"--key-file={key}",
                   f"--pid-file={folder}/munge.pid", f"--seed-file={folder}/munge.seed", f"--log-file={folder}/munge.log")
        while not (folder / "munge.socket").exists():  # no limits here: ctest has one
            self.alive("munged")
            time.sleep(0.1)
        self.start("slurmctld", "slurmctld", "-D")
        for node in ("n1", "n2"):
            self.start(node, "slurmd", "-D", "-N", node)
        while self.call("sinfo", "-h", "-o", "%T %D").strip() != "idle 2":
            for name in self.processes:
                self.alive(name)
            time.sleep(0.3)

    def start(self, name, *command):
        with (self.folder / f"{name}.out").open("w") as output:
            self.processes[name] = subprocess.Popen(command, env=self.environment, stdin=subprocess.DEVNULL, stdout=output,
                                                    stderr=subprocess.STDOUT)

    def alive(self, name):
        if self.processes[name].poll() is not None:
            raise AssertionError(f"{name} ended: {(self.folder / f'{name}.out').read_text()[-2000:]}")

    def call(self, *command):
        result = subprocess.run([str(part) for part in command], env=self.environment, stdin=subprocess.DEVNULL,
                                capture_output=True, text=True)
        return result.stdout if result.returncode == 0 else f"failed: {result.stderr}"

    def tasks(self):
        """{pid: (node, shard)} of the builds that run."""
        found = {}
        for entry in pathlib.Path("/proc").iterdir():
            if not entry.name.isdigit() or process_status(entry.name).get("Name") != "nadir":
                continue
            environment = environment_of(entry.name)
            if environment.get("SLURM_CONF") == self.environment["SLURM_CONF"] and "SLURM_ARRAY_TASK_ID" in environment:
                found[int(entry.name)] = (environment["SLURMD_NODENAME"], int(environment["SLURM_ARRAY_TASK_ID"]))
        return found

    def kill_node(self, node, task):
        """As a power cut: the daemon, the step that watches the task, and the task."""
        ancestors = [task]
        while True:
            parent = int(process_status(ancestors[-1]).get("PPid", "1"))
            # The step has left its daemon. Whoever has adopted it (init, a session of the user's) is none of ours.
            if parent == self.processes[node].pid or environment_of(parent).get("SLURM_CONF") != self.environment["SLURM_CONF"]:
                break
            ancestors.append(parent)
        daemon = self.processes[node]
        daemon.kill()
        daemon.wait()
        for pid in reversed(ancestors):
            os.kill(pid, signal.SIGKILL)

    def stop(self):
        if "slurmctld" in self.processes:
            self.call("scancel", "--state=PENDING,RUNNING")
        for name in reversed(list(self.processes)):
            process = self.processes[name]
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


class SlurmBuild(EndToEnd):
    def setUp(self):
        super().setUp()
        self.keys()
        # Zoom 21: a few seconds for each shard, long enough to be killed in.
        self.inputs = ["--mission", self.mission(change=lambda text: text.replace("max: 18", "max: 21")), "--imagery",
                       self.map()]
        self.plan = self.folder / "plan"
        self.good("cache", "plan-shards", *self.inputs, "--shards", SHARDS, "--out", self.plan)
        state = self.folder / "slurm"
        state.mkdir()
        self.cluster = Cluster(state)
        self.addCleanup(self.cluster.stop)

    def script(self, name, *arguments):
        """Submits by a script as the page prints it: the array, and the job after it."""
        page = (ROOT / "docs" / "scale.md").read_text()
        script = self.folder / name
        script.write_text(re.search(rf"```sh\n(#!/bin/bash\n# {name}.*?)```", page, re.S).group(1))
        output = self.cluster.call("bash", script, *arguments, "--ntasks=1", f"--output={self.folder}/job-%A-%a.log")
        self.assertRegex(output, r"^\d+ \d+\s*$")
        return output.split()

    def submit(self):
        return self.script("submit.sh", self.plan, SHARDS, self.folder / "signer.key.pem", self.folder / "merged")

    def wait_for(self, job):
        while (states := self.states(job))[0] != ["COMPLETED"]:
            self.assertIn(states[0], (["PENDING"], ["RUNNING"], ["COMPLETING"]), states[1] + self.logs())
            # Slurm lets a requeued task wait for two minutes; nobody else is waiting here.
            for line in self.cluster.call("squeue", "-h", "-r", "-t", "PENDING", "-o", "%i %r").splitlines():
                waiting, reason = line.split(" ", 1)
                if reason == "BeginTime":
                    self.cluster.call("scontrol", "update", f"jobid={waiting}", "StartTime=now")
            time.sleep(0.3)

    def same_files(self, one, other):
        files = [sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file()) for folder in (one, other)]
        self.assertEqual(files[0], files[1])
        for file in files[0]:
            self.assertTrue(filecmp.cmp(one / file, other / file, shallow=False), file)

    def stopped_in_its_work(self):
        """A task that has begun its shard and has not finished it, stopped so that it stays so: (pid, node, shard)."""
        while True:
            for pid, (node, shard) in self.cluster.tasks().items():
                journal = self.plan / f".shard-{shard}-of-{SHARDS}.staging" / "build.journal"
                try:
                    if journal.stat().st_size < 300_000:  # less than a metatile
                        continue
                    os.kill(pid, signal.SIGSTOP)
                except OSError:  # done meanwhile
                    continue
                if journal.exists() and process_status(pid):
                    return pid, node, shard
                os.kill(pid, signal.SIGCONT)
            time.sleep(0.02)

    def states(self, job):
        text = self.cluster.call("scontrol", "show", "job", job)
        return re.findall(r"JobState=(\w+)", text), text

    def test_a_node_is_killed_and_the_package_is_that_of_one_machine(self):
        array, merge = self.submit()
        pid, node, shard = self.stopped_in_its_work()
        self.cluster.kill_node(node, pid)
        staging = self.plan / f".shard-{shard}-of-{SHARDS}.staging"
        self.assertTrue(staging.exists())
        self.assertFalse((self.plan / f"shard-{shard}-of-{SHARDS}").exists())

        self.wait_for(merge)
        _, text = self.states(array)
        restarts = {int(task): int(count) for task, count in
                    re.findall(r"ArrayTaskId=(\d+) .*?Restarts=(\d+)", text, re.S)}
        self.assertEqual({one: int(one == shard) for one in range(1, SHARDS + 1)}, restarts, text)
        self.assertEqual(["COMPLETED"] * SHARDS, self.states(array)[0])
        self.good("cache", "build", *self.inputs, "--key", self.folder / "signer.key.pem", "--out", self.folder / "whole")
        whole, merged = self.folder / "whole", self.folder / "merged"
        self.same_files(whole, merged)
        self.assertEqual([], [p.name for p in self.plan.iterdir() if p.name.startswith(".")])

        # And the package's surveys.
        key, camera = self.folder / "signer.key.pem", self.folder / "camera.yaml"
        camera.write_text(CAMERA.format(width=320, height=240))
        for verb, into in (("matchability", ["--into-package"]), ("index", [])):
            _, merge = self.script("survey.sh", verb, merged, 2, key, camera, merge)
            self.good("cache", verb, whole, "--camera", camera, *into, "--key", key)
        self.wait_for(merge)
        self.same_files(whole, merged)

    def logs(self):
        return "".join(f"\n{path.name}: {path.read_text()}" for path in sorted(self.folder.glob("job-*.log")))

    def test_a_shard_that_fails_keeps_the_merge_from_running(self):
        # The imagery is no longer what was planned: every task refuses it, and the merge is cancelled.
        with (self.folder / "map.tif").open("ab") as file:
            file.write(b"\0")
        array, merge = self.submit()
        while self.cluster.call("squeue", "-h", "-j", f"{array},{merge}", "-o", "%i").strip():
            time.sleep(0.3)
        self.assertEqual({"FAILED"}, set(self.states(array)[0]))
        self.assertEqual(["CANCELLED"], self.states(merge)[0])
        self.assertIn("an input has changed since the plan was made", self.logs())
        self.assertFalse((self.folder / "merged").exists())


if __name__ == "__main__":
    missing = [program for program in PROGRAMS if shutil.which(program, path=PATH) is None]
    if missing:
        print(f"NOT TESTED: no Slurm: {', '.join(missing)} not installed (slurmctld, slurmd, slurm-client, munge)",
              file=sys.stderr)
        sys.exit(77)
    main()
