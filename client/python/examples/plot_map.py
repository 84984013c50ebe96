#!/usr/bin/env python3
"""Plots a map from above: its surfaces, its drives, its loops, and how far each loop is from the poses of now.

    plot_map.py http://127.0.0.1:8080 town map.png [--session monday --truth poses.txt]
    plot_map.py town.cellmap - map.png

With --truth (KITTI poses of the session's scans, sensor frame) also the errors of the trajectory, after the best fit.
"""

import argparse
import os
from collections.abc import Iterator

import matplotlib
import numpy as np
from numpy.typing import NDArray

import cellmap

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

COLOURS = {"accepted": "#2a8f4f", "weakened": "#d98a1f", "rejected": "#d0342c"}


def walls(cell: cellmap.Cell, pose: NDArray[np.float64]) -> NDArray[np.float64]:
    """(k, 3) the middles of upright patches within 40 m, map frame."""
    upright = (np.abs(cell.normals[:, 2]) < 0.3) & (cell.planes[:, 0] < 40)
    return cellmap.moved(cell.points[upright], pose)


def verdict(loop: cellmap.Constraint) -> str:
    return "rejected" if loop.weight == 0 else "accepted" if loop.weight == 1 or loop.pinned else "weakened"


def draw_map(axes: "plt.Axes", graph: cellmap.PoseGraph, cells: Iterator[tuple[int, cellmap.Cell]]) -> None:
    sessions: dict[str, list[tuple[int, int]]] = {}
    for ident, cell in cells:
        points = walls(cell, graph.pose(ident))
        axes.scatter(points[:, 0], points[:, 1], s=0.2, c="#9aa4ae", linewidths=0, rasterized=True)
        sessions.setdefault(cell.session, []).append((cell.sequence, ident))
    for name, drive in sorted(sessions.items()):
        way = np.array([graph.pose(ident)[:2, 3] for _, ident in sorted(drive)])
        axes.plot(way[:, 0], way[:, 1], linewidth=1.5, label=f"{name}: {len(way)} CELLs")
    for loop in graph.loops:
        ends = np.array([graph.pose(cell)[:2, 3] for cell in (loop.from_cell, loop.to_cell)])
        axes.plot(ends[:, 0], ends[:, 1], color=COLOURS[verdict(loop)], linewidth=0.8)
    axes.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axes.legend(loc="best", fontsize="small")


def draw_loop_errors(axes: "plt.Axes", graph: cellmap.PoseGraph) -> None:
    gaps = graph.residuals("loop")[:, 0] * 1000
    axes.bar(np.arange(len(gaps)), gaps, color=[COLOURS[verdict(loop)] for loop in graph.loops])
    axes.set(xlabel=f"{len(gaps)} loops", ylabel="gap [mm]", title="Loops against the poses of now")


def fitted(points: NDArray[np.float64], to: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) points after the rigid motion that brings them nearest to others (Umeyama 1991, without scale)."""
    u, _, vt = np.linalg.svd((to - to.mean(0)).T @ (points - points.mean(0)))
    turn = u @ np.diag([1, 1, np.linalg.det(u @ vt)]) @ vt
    moved: NDArray[np.float64] = (points - points.mean(0)) @ turn.T + to.mean(0)
    return moved


def draw_trajectory_errors(axes: "plt.Axes", client: cellmap.Client, name: str, session: str, truth_file: str) -> None:
    truth = np.loadtxt(truth_file).reshape(-1, 3, 4)[:, :, 3]
    for label, odometry in (("before (odometry)", True), ("after", False)):
        positions = client.trajectory(name, session, odometry=odometry)[1][:, :3, 3]
        count = min(len(truth), len(positions))
        errors = np.linalg.norm(fitted(positions[:count], truth[:count]) - truth[:count], axis=1)
        axes.plot(errors, label=f"{label}: rms {np.sqrt((errors**2).mean()):.3f} m")
    axes.set(xlabel="scan", ylabel="error [m]", title=f"Trajectory of {session}")
    axes.legend(fontsize="small")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("source", help="a server's address, or an archive (.cellmap file or address)")
    parser.add_argument("map", help="name of the map; - for an archive")
    parser.add_argument("out", help="PNG, PDF or SVG")
    parser.add_argument("--session", help="whose trajectory is compared with --truth")
    parser.add_argument("--truth", help="KITTI poses of its scans, sensor frame")
    options = parser.parse_args()
    figure, (left, right) = plt.subplots(1, 2, figsize=(13, 6.5), width_ratios=[2, 1], layout="constrained")
    if ".cellmap" in options.source:
        with cellmap.open_archive(options.source) as archive:
            draw_map(left, archive.pose_graph, ((entry.id, archive.cell(entry.id)) for entry in archive.cells))
            draw_loop_errors(right, archive.pose_graph)
    else:
        with cellmap.Client(options.source, os.environ.get("CELLMAP_TOKEN")) as client:
            graph = client.pose_graph(options.map)
            draw_map(left, graph, client.load_cells(options.map))
            if options.session and options.truth:
                draw_trajectory_errors(right, client, options.map, options.session, options.truth)
            else:
                draw_loop_errors(right, graph)
    figure.savefig(options.out, dpi=150)


if __name__ == "__main__":
    main()
