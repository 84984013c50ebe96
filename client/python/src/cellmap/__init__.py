"""CELLs, poses and relocalisation from a CELLmap server or archive, as numpy arrays.

>>> from cellmap import Client, open_archive
>>> client = Client("http://127.0.0.1:8080")
>>> answer = client.relocalise("town", points)      # (n, 3) metres, sensor frame
>>> answer.found, answer.T_map_scan                 # (4, 4)

Frames and formats: ``ARCHITECTURE.md`` and ``schema/FORMAT.md`` of the project.
"""

from .archive import Archive, ArchivedCell, ArchiveSummary, open_archive
from .archived_scans import ArchivedScans, Georeference
from .cell import Cell, Statistics, read_cell
from .changes import Changes, read_changes
from .client import Client
from .coded_cell import read_coarse_cell, read_coded_cell
from .documents import CellSummary, Job, MapSummary, Place, Relocalisation, Session
from .errors import Error
from .lattice import Lattice, lattice_of
from .pose_graph import Constraint, PoseGraph, Scores, read_pose_graph
from .poses import moved, pose_of_vector, vector_of_pose
from .scan import Scan, read_kitti, read_scan

__version__ = "0.1.0"
__all__ = [
    "Archive", "ArchiveSummary", "ArchivedCell", "ArchivedScans", "Cell", "CellSummary", "Changes", "Client", "Constraint",
    "Error", "Georeference", "Job", "Lattice", "MapSummary", "Place", "PoseGraph", "Relocalisation", "Scan", "Scores", "Session",
    "Statistics", "lattice_of", "moved", "open_archive", "pose_of_vector", "read_cell", "read_changes",
    "read_coarse_cell", "read_coded_cell", "read_kitti", "read_pose_graph", "read_scan", "vector_of_pose",
]
