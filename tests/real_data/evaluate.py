#!/usr/bin/env python3
"""The main job on real LiDAR data and on real odometry error, through the built `cellmap` and `cellmapd`.

  evaluate.py relocalise    each real data set ingested into a running cellmapd; held-back scans relocalised
  evaluate.py odometry      kitti00-keyframes with five real odometries: errors before and after each stage
  evaluate.py simulated     the simulator along KITTI 07 and 05 with real odometry error: the same table
  evaluate.py backend       pose graphs with 0, 25, 50 and 75 % false closures: what is rejected, errors

Options: --bin DIR (default build/release), --data DIR (default $CELLMAP_DATA or ../shared/data), --json FILE,
--only NAME (one data set, odometry or route), --keep DIR (work here and keep it).
Needs only Python's standard library. Prints Markdown tables.
"""
import argparse
import json
import math
import os
import random
import re
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


# --- rigid transforms as row-major 3x4 lists ----------------------------------------------------------------

def multiply(a, b):
    rows = []
    for i in range(3):
        for j in range(4):
            value = sum(a[4 * i + k] * b[4 * k + j] for k in range(3))
            rows.append(value + (a[4 * i + 3] if j == 3 else 0.0))
    return rows


def inverse(a):
    r = [a[4 * j + i] for i in range(3) for j in range(3)]
    t = [-sum(r[3 * i + k] * a[4 * k + 3] for k in range(3)) for i in range(3)]
    return [*r[0:3], t[0], *r[3:6], t[1], *r[6:9], t[2]]


def yaw_pose(x, y, yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    return [c, -s, 0, x, s, c, 0, y, 0, 0, 1, 0]


def to_quaternion(a):
    """x y z qx qy qz qw of a 3x4 pose."""
    m = [[a[4 * i + j] for j in range(3)] for i in range(3)]
    trace = m[0][0] + m[1][1] + m[2][2]
    if trace > 0:
        w = math.sqrt(1 + trace) / 2
        q = [(m[2][1] - m[1][2]) / (4 * w), (m[0][2] - m[2][0]) / (4 * w), (m[1][0] - m[0][1]) / (4 * w), w]
    else:
        i = max(range(3), key=lambda k: m[k][k])
        j, k = (i + 1) % 3, (i + 2) % 3
        s = math.sqrt(1 + m[i][i] - m[j][j] - m[k][k])
        q = [0.0] * 4
        q[i] = s / 2
        q[j] = (m[i][j] + m[j][i]) / (2 * s)
        q[k] = (m[i][k] + m[k][i]) / (2 * s)
        q[3] = (m[k][j] - m[j][k]) / (2 * s)
    norm = math.sqrt(sum(v * v for v in q))
    return [a[3], a[7], a[11], *[v / norm for v in q]]


def from_quaternion(p):
    x, y, z, qx, qy, qz, qw = p
    return [1 - 2 * (qy * qy + qz * qz), 2 * (qx * qy - qz * qw), 2 * (qx * qz + qy * qw), x,
            2 * (qx * qy + qz * qw), 1 - 2 * (qx * qx + qz * qz), 2 * (qy * qz - qx * qw), y,
            2 * (qx * qz - qy * qw), 2 * (qy * qz + qx * qw), 1 - 2 * (qx * qx + qy * qy), z]


def difference(a, b):
    """Metres and degrees between two poses."""
    d = multiply(inverse(a), b)
    cosine = max(-1.0, min(1.0, (d[0] + d[5] + d[10] - 1) / 2))
    return math.sqrt(d[3] ** 2 + d[7] ** 2 + d[11] ** 2), math.degrees(math.acos(cosine))


def quantile(values, q):
    values = sorted(values)
    return values[min(len(values) - 1, int(q * len(values)))] if values else float("nan")


# --- running the product --------------------------------------------------------------------------------------

def rows_of(file):
    return [[float(v) for v in line.split()] for line in Path(file).read_text().splitlines() if line.strip()]


class Product:
    def __init__(self, folder):
        self.cellmap, self.cellmapd = folder / "client" / "cellmap", folder / "server" / "cellmapd"

    def run(self, *arguments):
        """Runs `cellmap ARGUMENTS --json` and returns what it printed."""
        command = [str(self.cellmap), *map(str, arguments), "--json"]
        done = subprocess.run(command, capture_output=True, text=True)
        if done.returncode != 0:
            raise RuntimeError(f"{' '.join(command)}\n{done.stdout}{done.stderr}")
        return json.loads(done.stdout) if done.stdout.strip() else {}


class Server:
    """A cellmapd on a free loopback port with a fresh store."""

    def __init__(self, product, folder):
        self.process = subprocess.Popen(
            [str(product.cellmapd), "--store", str(folder / "map.db"), "--listen", "127.0.0.1:0", "--threads", "2"],
            stdout=subprocess.PIPE, stderr=open(folder / "cellmapd.log", "w"), text=True)
        line = self.process.stdout.readline()
        self.url = re.search(r"http://\S+", line).group(0)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.terminate()
        self.process.wait(30)


def hold_back(source, scans_folder, poses_file, target, every):
    """A data set without each `every`-th scan. Of those: [(scan file, its row of the pose file, how many scans were
    kept before it, the pose row of the last of them)]."""
    target.mkdir(parents=True)
    (target / "velodyne").mkdir()
    scans = sorted(p for p in (source / scans_folder).iterdir() if p.suffix in (".bin", ".pcd", ".ply"))
    poses = (source / poses_file).read_text().splitlines()
    times = (source / "times.txt").read_text().split() if (source / "times.txt").exists() else None
    if (source / "calib.txt").exists():
        (target / "calib.txt").symlink_to(source / "calib.txt")
    kept, held = [], []
    for i, scan in enumerate(scans):
        if i % every == every // 2:
            row_of = lambda k: [float(v) for v in poses[k].split()]
            held.append((scan, row_of(i), len(kept), row_of(kept[-1])))
        else:
            kept.append(i)
            (target / "velodyne" / scan.name).symlink_to(scan)
    (target / "poses.txt").write_text("".join(poses[i] + "\n" for i in kept))
    if times:
        (target / "times.txt").write_text("".join(times[i] + "\n" for i in kept))
    return held


DATA_SETS = [
    # name, scans folder, poses, hold back each n-th, options of ingest
    ("kitti00-consecutive", "velodyne", "poses.txt", 5, []),
    ("kitti00-dense", "velodyne", "poses_gt.txt", 5, []),
    ("kitti00-keyframes", "velodyne", "poses_gt.txt", 10, ["--lattice-size", "20000"]),
    ("mulran-kaist03", "scans", "optimized_poses.txt", 4, []),
]


def relocalise(product, data, work, only):
    results = []
    for name, scans_folder, poses_file, every, options in DATA_SETS:
        if only and name != only:
            continue
        if not (data / name).exists():
            print(f"skipped {name}: not in {data}", file=sys.stderr)
            continue
        folder = work / name
        held = hold_back(data / name, scans_folder, poses_file, folder / "drive", every)
        camera = (data / name / "calib.txt").exists()
        with Server(product, folder) as server:
            at = ["--server", server.url, "--map", name]
            product.run("ingest", folder / "drive", *at, *options)
            info = product.run("info", name, "--server", server.url)
            product.run("export", "trajectory", *at, "--format", "kitti", "--out", folder / "trajectory.txt")
            truths = truth_in_map(held, rows_of(folder / "trajectory.txt"),
                                  data / name / "calib.txt" if camera else None)
            for prior_wrong in (True, False):
                results.append(relocalise_all(product, at, name, info, held, truths, prior_wrong))
    print("| data set | CELLs | bytes a CELL | prior | scans | found | wrong (> 1.5 m or 3 deg) | error m, median / 95 % "
          "| error deg, median / 95 % | ms, median |\n|---|---|---|---|---|---|---|---|---|---|")
    for r in results:
        print(f"| {r['data']} | {r['cells']} | {r['bytes_per_cell']:.0f} | {r['prior']} | {r['queries']} | {r['found']} "
              f"| {r['wrong']} | {r['error_m']['median']:.3f} / {r['error_m']['p95']:.3f} "
              f"| {r['error_deg']['median']:.2f} / {r['error_deg']['p95']:.2f} | {r['query_ms']['median']:.0f} |")
    return results


def truth_in_map(held, trajectory, calib):
    """Where each held-back scan is in the map: the corrected pose of the scan before it, and the way from there that
    the data set's poses give. So neither the drift of the map nor that of the ground truth counts as error."""
    to_sensor = lambda row: row
    if calib is not None:
        line = next(l for l in calib.read_text().splitlines() if l.startswith("Tr"))
        tr = [float(v) for v in line.split()[1:]]
        to_sensor = lambda row: multiply(inverse(tr), multiply(row, tr))
    return [multiply(trajectory[kept - 1], multiply(inverse(to_sensor(before)), to_sensor(row)))
            for _, row, kept, before in held]


def relocalise_all(product, at, name, info, held, truths, prior_wrong):
    randomness = random.Random(1)
    metres, degrees, times, found, wrong = [], [], [], 0, 0
    for (scan, *_), truth in zip(held, truths):
        arguments = []
        if prior_wrong:
            heading, sign = randomness.uniform(0, 2 * math.pi), randomness.choice((-1, 1))
            off = yaw_pose(2 * math.cos(heading), 2 * math.sin(heading), sign * math.radians(10))
            prior = to_quaternion(multiply(truth, off))
            arguments = ["--prior", " ".join(f"{v:.9f}" for v in prior), "--radius", "10"]
        answer = product.run("relocalise", scan, *at, *arguments)
        times.append(answer["time_ms"])
        if not answer["found"]:
            continue
        found += 1
        error_m, error_deg = difference(truth, from_quaternion(answer["T_map_scan"]))
        wrong += error_m > 1.5 or error_deg > 3
        metres.append(error_m)
        degrees.append(error_deg)
    spread = lambda v: {"median": quantile(v, 0.5), "p95": quantile(v, 0.95)}
    return {"data": name, "cells": info["cells"], "bytes_per_cell": info["stored_bytes"] / max(info["cells"], 1),
            "prior": "2 m, 10 deg wrong" if prior_wrong else "none", "queries": len(held), "found": found,
            "wrong": wrong, "error_m": spread(metres), "error_deg": spread(degrees), "query_ms": spread(times)}


STAGES = [("odometry", ["--no-bidirectional", "--no-loops"]), ("bidirectional", ["--no-loops"]), ("loops", []),
          ("loops, paper's acceptance", ["--loop-acceptance", "paper"])]


def stage_errors(product, work, name, dataset, poses, truth, options):
    """Errors of the corrected trajectory after each stage of the back end."""
    row = {"data": name}
    for stage, flags in STAGES:
        store = work / f"{name}-{stage}.db"
        product.run("build", dataset, "--poses", poses, "--store", store, "--map", "m", *options, *flags)
        out = work / f"{name}-{stage}.txt"
        product.run("export", "trajectory", "--store", store, "--map", "m", "--format", "kitti", "--out", out)
        row[stage] = product.run("evaluate", "trajectory", "--estimate", out, "--truth", truth)
        loops = product.run("loops", "list", "m", "--store", store)["loops"]
        row[stage]["loops"] = len(loops)
        row[stage]["wrong_loops"] = wrong_loops(loops, base_scans(product, store, out), rows_of(truth))
    return row


def base_scans(product, store, trajectory):
    """The base scan of each CELL, by the CELL's id: the scan whose corrected pose is the CELL's."""
    cells = product.run("cells", "m", "--store", store, "--all")["cells"]
    rows = rows_of(trajectory)
    return {cell["id"]: min(range(len(rows)), key=lambda i: math.dist(rows[i][3::4], cell["pose"][:3]))
            for cell in cells}


def wrong_loops(loops, base_scan, truth):
    """How many are more than 1.5 m or 3 deg off the truth (which is itself 0.8 m off at KITTI's revisits)."""
    wrong = 0
    for loop in loops:
        T_true = multiply(inverse(truth[base_scan[loop["from"]]]), truth[base_scan[loop["to"]]])
        error_m, error_deg = difference(T_true, from_quaternion(loop["pose"]))
        wrong += error_m > 1.5 or error_deg > 3
    return wrong


def print_stages(rows):
    print("| drive | stage | t_rel % | r_rel deg/100 m | APE m | loops | wrong |\n|---|---|---|---|---|---|---|")
    for row in rows:
        for stage, _ in STAGES:
            e = row[stage]
            print(f"| {row['data']} | {stage} | {e['t_rel_percent']:.3f} | {e['r_rel_deg_per_100m']:.3f} "
                  f"| {e['ape_rmse_m']:.3f} | {e['loops']} | {e['wrong_loops']} |")


def odometry(product, data, work, only):
    dataset = data / "kitti00-keyframes"
    names = [p.stem.removeprefix("odom_") for p in sorted(dataset.glob("odom_*.txt"))]
    # About 6,000 points a scan fill a coarse lattice only; 0.205 deg is the paper's correction for KITTI's HDL-64E.
    options = ["--lattice-size", "8000", "--angle-correction", "0.205"]
    rows = [stage_errors(product, work, name, dataset, dataset / f"odom_{name}.txt", dataset / "poses_gt.txt", options)
            for name in names if not only or name == only]
    print_stages(rows)
    return rows


def simulated(product, data, work, only):
    rows = []
    for sequence, system in (("07", "simple_online"), ("07", "gicp_f2f"), ("05", "simple_online"), ("05", "gicp_f2f")):
        name = f"{sequence}-{system}"
        if only and only not in name:
            continue
        drive = work / f"drive-{name}"
        trajectories = data / "kitti-trajectories"
        product.run("simulate", "--route", trajectories / "ground_truth" / f"{sequence}.txt", "--odometry",
                    trajectories / "odometry" / system / f"{sequence}.txt", "--out", drive)
        rows.append(stage_errors(product, work, name, drive, drive / "poses.txt", drive / "poses_gt.txt", []))
    print_stages(rows)
    return rows


# --- pose graphs with false closures -----------------------------------------------------------------------

SHARES = (0.0, 0.25, 0.5, 0.75)


class Graph:
    """Lines of g2o: odometry, then loops of which it is known whether they are true; and the true poses."""

    def __init__(self, name, odometry, true_loops, truth):
        self.name, self.odometry, self.true_loops, self.truth = name, odometry, true_loops, truth

    def false_loops(self, count):
        raise NotImplementedError


def planar(line):
    word = line.split()
    return int(word[1]), int(word[2]), yaw_pose(*(float(v) for v in word[3:6]))


class RecordedGraph(Graph):
    """Visual odometry and bag-of-words closures on KITTI, false ones as the detector gave them."""

    def __init__(self, folder, sequence):
        lines = lambda name: [l for l in (folder / sequence / name).read_text().splitlines() if l.startswith("EDGE")]
        is_loop = lambda line: planar(line)[1] != planar(line)[0] + 1
        known = {tuple(map(int, l.split())) for l in
                 (folder / sequence / f"kitti_{sequence}_alpha_0.00_GT_LC.txt").read_text().splitlines() if l.strip()}
        edges = lines(f"kitti_{sequence}_alpha_0.00.g2o")
        loops = [l for l in edges if is_loop(l)]
        truth = [yaw_pose(0, 0, 0)]
        for line in lines(f"kitti_{sequence}_GT.g2o"):
            truth.append(multiply(truth[-1], planar(line)[2]))
        super().__init__(f"robustslam-kitti {sequence}", [l for l in edges if not is_loop(l)],
                         [l for l in loops if planar(l)[:2] in known], truth)
        self.wrong = [l for l in loops if planar(l)[:2] not in known]
        random.Random(1).shuffle(self.wrong)

    def false_loops(self, count):
        return self.wrong[:count]


class RouteGraph(Graph):
    """A CELL every 6 m of KITTI's ground truth, tied by a real LiDAR odometry; closures where the route comes back
    within 8 m, measured with the mapper's uncertainty. False ones in groups of up to six neighbours that agree with
    one another, as where places look alike."""

    SIGMA_M, SIGMA_RAD = 0.05, 0.002

    def __init__(self, trajectories, system, sequence):
        truth = rows_of(trajectories / "ground_truth" / f"{sequence}.txt")
        odometry = rows_of(trajectories / "odometry" / system / f"{sequence}.txt")
        keys = [0]
        for i, row in enumerate(truth):
            if math.dist(row[3::4], truth[keys[-1]][3::4]) > 6:
                keys.append(i)
        self.random = random.Random(3)
        truth, odometry = [truth[i] for i in keys], [odometry[i] for i in keys]
        super().__init__(f"{sequence} {system}", [
            self.edge(i, i + 1, multiply(inverse(odometry[i]), odometry[i + 1]), 0.12, math.radians(0.12), 0)
            for i in range(len(keys) - 1)], [], truth)
        for i in range(len(truth)):
            near = [j for j in range(i - 20) if math.dist(truth[i][3::4], truth[j][3::4]) < 8]
            self.true_loops += [self.loop(j, i, multiply(inverse(truth[j]), truth[i])) for j in near[:2]]

    def edge(self, a, b, pose, sigma_m, sigma_rad, noise):
        small = lambda sigma: self.random.gauss(0, sigma * noise)
        turn = from_quaternion([0, 0, 0, *self.unit([small(sigma_rad) / 2 for _ in range(3)] + [1.0])])
        noisy = multiply(turn, [0 if i % 4 == 3 else v for i, v in enumerate(pose)])
        for i in (3, 7, 11):
            noisy[i] = pose[i] + small(sigma_m)
        weights = [sigma_m ** -2] * 3 + [sigma_rad ** -2] * 3
        upper = [weights[i] if i == k else 0 for i in range(6) for k in range(i, 6)]
        return " ".join(map(repr, ["EDGE_SE3:QUAT", a, b, *to_quaternion(noisy), *upper])).replace("'", "")

    @staticmethod
    def unit(q):
        norm = math.sqrt(sum(v * v for v in q))
        return [v / norm for v in q]

    def loop(self, a, b, pose):
        return self.edge(a, b, pose, self.SIGMA_M, self.SIGMA_RAD, 1)

    def false_loops(self, count):
        n, found = len(self.truth), []
        while len(found) < count:
            a, b = sorted((self.random.randrange(n), self.random.randrange(n)))
            if b < a + 20 or math.dist(self.truth[a][3::4], self.truth[b][3::4]) < 20:
                continue
            heading = self.random.choice((0.0, math.pi)) + self.random.gauss(0, 0.05)
            guess = from_quaternion([self.random.gauss(0, 2), 0, self.random.gauss(0, 2),
                                     0, math.sin(heading / 2), 0, math.cos(heading / 2)])
            for k in range(min(self.random.randint(1, 6), count - len(found), n - b)):
                step_a = multiply(inverse(self.truth[a]), self.truth[a + k])
                step_b = multiply(inverse(self.truth[b]), self.truth[b + k])
                found.append(self.loop(a + k, b + k, multiply(inverse(step_a), multiply(guess, step_b))))
        return found


def vertices(file):
    rows = {}
    for line in file.read_text().splitlines():
        if line.startswith("VERTEX_SE3:QUAT"):
            word = line.split()
            rows[int(word[1])] = from_quaternion([float(v) for v in word[2:9]])
    return [rows[i] for i in sorted(rows)]


def write_rows(file, rows):
    file.write_text("".join(" ".join(f"{v:.9f}" for v in row) + "\n" for row in rows))


def absolute_error(product, work, graph, solved):
    write_rows(work / "truth.txt", graph.truth)
    write_rows(work / "estimate.txt", vertices(solved))
    return product.run("evaluate", "trajectory", "--estimate", work / "estimate.txt", "--truth",
                       work / "truth.txt")["ape_rmse_m"]


def solve_with_false(product, work, graph, share, options):
    false_loops = graph.false_loops(round(share / (1 - share) * len(graph.true_loops)))
    (work / "in.g2o").write_text("\n".join(graph.odometry + graph.true_loops + false_loops) + "\n")
    solved = product.run("optimize", work / "in.g2o", work / "out.g2o", *options)
    kept = [loop["weight"] > 0 for loop in solved["loops"]]
    n = len(graph.true_loops)
    return {"graph": graph.name, "method": " ".join(options) or "default",
            "false_percent": round(100 * len(false_loops) / max(1, n + len(false_loops))),
            "true_loops": n, "false_loops": len(false_loops), "true_kept": sum(kept[:n]), "false_kept": sum(kept[n:]),
            "ape_m": absolute_error(product, work, graph, work / "out.g2o"), "iterations": solved["iterations"],
            "time_ms": solved["time_ms"], "final_cost": solved["final_cost"], "converged": solved["converged"]}


def backend(product, data, work, only):
    trajectories = data / "kitti-trajectories"
    graphs = [lambda s=s: RecordedGraph(data / "g2o" / "robustslam-kitti", s) for s in ("00", "05")]
    graphs += [lambda o=o, s=s: RouteGraph(trajectories, o, s)
               for o, s in (("kiss_icp", "00"), ("ndt_f2f", "00"), ("simple_online", "02"), ("simple_online", "05"),
                            ("gicp_f2f", "05"), ("gicp_f2f", "07"))]
    rows = []
    for make in graphs:
        graph = make()
        if only and only not in graph.name:
            continue
        (work / "in.g2o").write_text("\n".join(graph.odometry) + "\n")
        product.run("optimize", work / "in.g2o", work / "out.g2o")
        odometry_ape = absolute_error(product, work, graph, work / "out.g2o")
        for options in ([], ["--graduated"], ["--least-squares"]):
            for share in SHARES:
                row = solve_with_false(product, work, graph, share, options)
                row["odometry_ape_m"] = odometry_ape
                row["ape_ratio"] = row["ape_m"] / (rows[-1]["clean_ape_m"] if share else row["ape_m"])
                row["clean_ape_m"] = rows[-1]["clean_ape_m"] if share else row["ape_m"]
                rows.append(row)
    print("| graph | method | false | true kept | false kept | odometry APE m | APE m | to 0 % | steps | ms |\n"
          "|---|---|---|---|---|---|---|---|---|---|")
    for r in rows:
        print(f"| {r['graph']} | {r['method']} | {r['false_percent']} % | {r['true_kept']}/{r['true_loops']} "
              f"| {r['false_kept']}/{r['false_loops']} | {r['odometry_ape_m']:.2f} | {r['ape_m']:.3f} "
              f"| {r['ape_ratio']:.3f} | {r['iterations']} | {r['time_ms']:.0f} |")
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=["relocalise", "odometry", "simulated", "backend"])
    parser.add_argument("--bin", type=Path, default=ROOT / "build" / "release")
    parser.add_argument("--data", type=Path, default=Path(os.environ.get("CELLMAP_DATA", ROOT / ".." / "shared" / "data")))
    parser.add_argument("--json", type=Path)
    parser.add_argument("--only")
    parser.add_argument("--keep", type=Path)
    arguments = parser.parse_args()
    if not arguments.data.exists():
        sys.exit(f"no real data at {arguments.data}: set CELLMAP_DATA")
    verb = {"relocalise": relocalise, "odometry": odometry, "simulated": simulated,
            "backend": backend}[arguments.what]
    with tempfile.TemporaryDirectory() as temporary:
        work = arguments.keep or Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        rows = verb(Product(arguments.bin.resolve()), arguments.data.resolve(), work.resolve(), arguments.only)
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=2))


if __name__ == "__main__":
    main()
