"""Draws the displays of the RViz and Foxglove layouts into docs/images, for `make docs`.

Simulator, driver and filter run, and each display and panel is drawn from the messages on its topics.
Neither program is needed: the pictures are drawings, not screenshots.
"""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
import textwrap
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import yaml
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from rclpy.qos import QoSProfile
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Empty, Trigger
from visualization_msgs.msg import Marker, MarkerArray

from tactile_localizer.demo.nodes import Nodes, own_domain
from tactile_localizer.demo.show import Watcher
from tactile_localizer.io.scans.store import ScanStore
from tactile_localizer.io.scene_file import load_scene
from tactile_localizer.msg import Posterior
from tactile_localizer.resources import resource_path
from tactile_localizer.ros.base.qos import LATCHED
from tactile_localizer.ros.conversions.timestamps import to_ns
from tactile_localizer.sim import simulate_scan

IMAGES = Path(__file__).parents[1] / "images"
DARK = "#222222"
TOPICS: dict[str, tuple[Any, QoSProfile | int]] = {
    "/filter/map": (PointCloud2, LATCHED),
    "/filter/feature_region": (Marker, LATCHED),
    "/filter/particles": (PointCloud2, 10),
    "/filter/pose": (PoseWithCovarianceStamped, 100),
    "/filter/markers": (MarkerArray, 10),
    "/filter/posterior": (Posterior, 1000),
    "/simulator/ground_truth": (PoseStamped, 100),
    "/diagnostics": (DiagnosticArray, 10),
}
TRAVEL_M = 0.024
"""Travel of the hand, m; it continues until the next diagnostics."""

_COLUMNS = 48
"""Characters per line in a text panel."""

Messages = dict[str, list[Any]]


def write_scan(path: Path) -> None:
    """Write a simulated training scan of the bump, with the shipped scene."""
    scan = simulate_scan("bump", 1)
    with ScanStore.create(path, load_scene(resource_path("config/scenes/bump.yaml"))) as store:
        for part in scan.slices():
            store.begin_sweep()
            store.append(scan.stamp_ns[part], scan.odometry[part], scan.strain[part])
            store.end_sweep()


def listen() -> Messages:
    """The messages of a filter while the hand sweeps onto the bump."""
    messages: Messages = defaultdict(list)
    with tempfile.TemporaryDirectory() as name, own_domain() as domain:
        folder = Path(name)
        os.environ.update(domain.environment)
        write_scan(folder / "scan.db")
        simulated = {"mode": "localize", "seed": 2, "speed": 2.0, "load_cell_rate_hz": 40.0}
        with (
            Nodes(folder, domain.environment) as nodes,
            contextlib.closing(Watcher(domain.number)) as watcher,
        ):
            nodes.start("simulator", domain.bus | simulated)
            nodes.start("driver", domain.bus | {"tare_file": str(folder / "tare.yaml")})
            nodes.start("filter", {"scan_file": str(folder / "scan.db")})
            for topic, (kind, quality) in TOPICS.items():
                watcher.listen(kind, topic, quality, messages[topic].append)
            watcher.until(lambda: messages["/filter/posterior"] and messages["/filter/map"], "the filter")
            posteriors = messages["/filter/posterior"]
            watcher.call(Trigger, "simulator/prepare")
            watcher.call(Empty, "filter/reinitialize_global_localization")
            count = len(posteriors)
            watcher.until(lambda: len(posteriors) > count + 10, "the uniform belief")
            for topic in ("/filter/posterior", "/simulator/ground_truth"):
                messages[topic].clear()
            watcher.call(Trigger, "simulator/sweep")
            watcher.until(lambda: posteriors and posteriors[-1].travel > TRAVEL_M, "the hand to slide")
            messages["/diagnostics"].clear()
            watcher.until(
                lambda: {"filter", "driver"} <= senders(messages["/diagnostics"]), "the diagnostics"
            )
            return {topic: list(received) for topic, received in messages.items()}


def senders(arrays: list[Any]) -> set[str]:
    """Nodes that have published diagnostics."""
    return {status.name.split(":")[0].removesuffix("_node") for array in arrays for status in array.status}


def columns(cloud: PointCloud2) -> dict[str, np.ndarray]:
    """The fields of a point cloud, each (n,)."""
    table = np.frombuffer(cloud.data, "<f4").reshape(cloud.width, cloud.point_step // 4)
    return {field.name: table[:, field.offset // 4] for field in cloud.fields}


def colour(message: Any) -> tuple[float, float, float, float]:
    """The color of a marker for matplotlib."""
    return message.r, message.g, message.b, message.a


def draw_marker(axes: Axes, marker: Marker) -> None:
    """Draw the lines, spheres or text of a marker."""
    points = np.array([(point.x, point.y) for point in marker.points]).reshape(-1, 2)
    if marker.type == Marker.TEXT_VIEW_FACING:
        place = marker.pose.position
        style = {"color": colour(marker.color), "ha": "center", "va": "center", "fontsize": 9}
        axes.text(place.x, place.y, marker.text, **style)
    elif marker.type == Marker.SPHERE_LIST:
        for x, y in points:
            size = marker.scale.x
            axes.add_patch(Ellipse((x, y), size, size, fc=colour(marker.color), ec="none", zorder=4))
    else:
        axes.plot(*points.T, color=colour(marker.color), lw=1.2, zorder=4)


def draw_pose(axes: Axes, pose: PoseWithCovarianceStamped, length: float) -> None:
    """Two axes and the covariance's ellipse, one standard deviation."""
    place = pose.pose.pose.position
    covariance = np.reshape(pose.pose.covariance, (6, 6))[:2, :2]
    values, vectors = np.linalg.eigh(covariance)
    angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
    width, height = 2 * np.sqrt(np.maximum(values[::-1], 0.0))
    axes.add_patch(
        Ellipse((place.x, place.y), width, height, angle=angle, fc="#cc33cc", alpha=0.35, zorder=5)
    )
    axes.plot([place.x, place.x + length], [place.y, place.y], color="red", lw=2, zorder=6)
    axes.plot([place.x, place.x], [place.y, place.y + length], color="lime", lw=2, zorder=6)


def draw_cloud(axes: Axes, cloud: PointCloud2, channel: str, colours: Any, size: float, alpha: float) -> None:
    """Points coloured by a channel."""
    of = columns(cloud)
    order = np.argsort(of[channel])
    x, y, value = of["x"][order], of["y"][order], of[channel][order]
    axes.scatter(x, y, c=value, cmap=colours, s=size, marker="s", alpha=alpha, linewidths=0)


def draw_rviz(messages: Messages) -> Figure:
    """The displays of the RViz layout, in its view from above."""
    layout = yaml.safe_load(resource_path("config/rviz/localize.rviz").read_text())["Visualization Manager"]
    figure = plt.figure(figsize=(9, 6), facecolor=DARK)
    axes = figure.add_axes((0, 0, 1, 1), facecolor=DARK)
    for display in layout["Displays"]:
        kind, topic = display["Class"].split("/")[1], display.get("Topic", {}).get("Value")
        if kind == "Grid":
            half, cell = display["Plane Cell Count"] * display["Cell Size"] / 2, display["Cell Size"]
            for at in np.arange(-half, half + cell / 2, cell) + display["Offset"]["X"]:
                axes.axvline(at, color="0.31", lw=0.5, zorder=0)
                axes.axhline(at, color="0.31", lw=0.5, zorder=0)
        elif kind == "PointCloud2" and display["Use rainbow"]:
            size = (display["Size (m)"] * 9 * 72 / 0.096) ** 2
            draw_cloud(axes, messages[topic][-1], display["Channel Name"], "jet", size, display["Alpha"])
        elif kind == "PointCloud2":
            ends = [
                [int(part) / 255 for part in display[f"{end} Color"].split(";")] for end in ("Min", "Max")
            ]
            colours = LinearSegmentedColormap.from_list("rviz", ends)
            draw_cloud(axes, messages[topic][-1], display["Channel Name"], colours, 9, display["Alpha"])
        elif kind == "PoseWithCovariance":
            draw_pose(axes, messages[topic][-1], display["Axes Length"])
        else:
            newest = messages[topic][-1]
            for marker in getattr(newest, "markers", [newest]):
                draw_marker(axes, marker)
    view = layout["Views"]["Current"]
    axes.set_xlim(view["X"] - 0.048, view["X"] + 0.048)
    axes.set_ylim(view["Y"] - 0.032, view["Y"] + 0.032)
    axes.axis("off")
    return figure


def places(node: Any, left: float, bottom: float, width: float, height: float) -> Iterator[tuple[str, Any]]:
    """Rectangle of each panel of a Foxglove layout, in figure coordinates."""
    if isinstance(node, str):
        yield node, (left, bottom, width, height)
        return
    first = node.get("splitPercentage", 50) / 100
    if node["direction"] == "row":
        yield from places(node["first"], left, bottom, first * width, height)
        yield from places(node["second"], left + first * width, bottom, (1 - first) * width, height)
    else:
        yield from places(node["first"], left, bottom + (1 - first) * height, width, first * height)
        yield from places(node["second"], left, bottom, width, (1 - first) * height)


def follow(message: Any, fields: list[str]) -> Any:
    """The value at a message path."""
    for field in fields:
        name, _, index = field.partition("[")
        message = getattr(message, name)
        message = message[int(index[:-1])] if index else message
    return message


def draw_foxglove(messages: Messages) -> Figure:
    """The panels of the Foxglove layout, each in its place."""
    layout = json.loads(resource_path("config/foxglove/localize.json").read_text())
    figure = plt.figure(figsize=(13, 8), facecolor="white")
    start_ns = to_ns(messages["/filter/posterior"][0].header.stamp)
    for name, (left, bottom, width, height) in places(layout["layout"], 0.0, 0.0, 1.0, 1.0):
        config, kind = layout["configById"][name], name.partition("!")[0]
        pad = (0.0, 0.0, 0.0, 0.0) if kind == "3D" else (0.05, 0.045, 0.01, 0.035)
        where = (left + pad[0], bottom + pad[1], width - pad[0] - pad[2], height - pad[1] - pad[3])
        axes = figure.add_axes(where)
        if kind == "3D":
            draw_3d(axes, config, messages)
        elif kind in ("Plot", "StateTransitions"):
            draw_paths(axes, config, messages, start_ns)
        elif kind == "RawMessages":
            topic, *fields = config["topicPath"].split(".")
            axes.set_title(config["topicPath"], fontsize=8, loc="left")
            value = textwrap.fill(str(follow(messages[topic][-1], fields)), _COLUMNS)
            axes.text(0.0, 0.9, value, va="top", fontsize=8)
            axes.axis("off")
        else:
            draw_diagnostics(axes, messages[config["topicToRender"]])
    return figure


def draw_3d(axes: Axes, config: Any, messages: Messages) -> None:
    """The material from above."""
    axes.set_facecolor(config["scene"]["backgroundColor"])
    for topic, how in config["topics"].items():
        newest = messages[topic][-1]
        if isinstance(newest, PointCloud2):
            colours = how.get("colorMap") or LinearSegmentedColormap.from_list("gradient", how["gradient"])
            draw_cloud(axes, newest, how["colorField"], colours, how["pointSize"] ** 2 / 2, 0.8)
        elif isinstance(newest, PoseWithCovarianceStamped):
            draw_pose(axes, newest, how["axisScale"])
        else:
            for marker in getattr(newest, "markers", [newest]):
                draw_marker(axes, marker)
    x, y, _ = config["cameraState"]["targetOffset"]
    axes.set_xlim(x - 0.038, x + 0.038)
    axes.set_ylim(y - 0.032, y + 0.032)
    axes.set_xticks([])
    axes.set_yticks([])


def draw_paths(axes: Axes, config: Any, messages: Messages, start_ns: int) -> None:
    """Values over the time of their stamps."""
    for number, path in enumerate(config["paths"]):
        topic, *fields = path["value"].split(".")
        stamps = [(to_ns(message.header.stamp) - start_ns) * 1e-9 for message in messages[topic]]
        values = np.array([follow(message, fields) for message in messages[topic]], dtype=np.float64)
        if "title" not in config:  # states: a band each
            axes.fill_between(stamps, number + 0.15, number + 0.15 + 0.7 * values, step="post")
            axes.text(0.0, number + 0.4, f" {path['label']}", fontsize=8)
        else:
            axes.plot(stamps, values, label=path["label"], lw=1.2)
    if "title" in config:
        axes.legend(fontsize=7, loc="upper left")
        axes.set_title(config["title"], fontsize=8, loc="left")
    else:
        axes.set_ylim(0, len(config["paths"]))
        axes.set_yticks([])
    axes.tick_params(labelsize=7)


def draw_diagnostics(axes: Axes, arrays: list[Any]) -> None:
    """The newest status of each name, the worst first."""
    newest = {status.name: status for array in arrays for status in array.status}
    axes.set_title("Diagnostics", fontsize=8, loc="left")
    for row, status in enumerate(sorted(newest.values(), key=lambda one: one.level, reverse=True)):
        shade = {b"\0": "tab:green", b"\1": "tab:orange"}.get(status.level, "tab:red")
        axes.text(0.0, 0.95 - 0.17 * row, status.name, color=shade, fontsize=7.5, va="top", weight="bold")
        axes.text(0.0, 0.865 - 0.17 * row, f"   {status.message}"[:60], fontsize=6.5, va="top")
    axes.axis("off")


def main() -> None:
    """Listen once, draw both."""
    messages = listen()
    for name, draw in (("rviz", draw_rviz), ("foxglove", draw_foxglove)):
        figure = draw(messages)
        figure.savefig(IMAGES / f"{name}.png", dpi=100, facecolor=figure.get_facecolor())


if __name__ == "__main__":
    main()
