import numpy as np
import pytest

from cellmap import Error, moved, pose_of_vector, vector_of_pose


def test_poses_and_their_seven_numbers_are_the_same_thing() -> None:
    dice = np.random.default_rng(3)
    turns = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1], *dice.normal(size=(200, 4))]
    for turn in turns:
        q = np.array(turn, dtype=np.float64) / np.linalg.norm(turn)
        vector = np.concatenate([dice.normal(size=3) * 100, -q if q[3] < 0 else q])
        pose = pose_of_vector(vector)
        assert np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-14)
        back = vector_of_pose(pose)
        assert np.allclose(back[:3], vector[:3], atol=0)
        assert min(np.abs(back[3:] - vector[3:]).max(), np.abs(back[3:] + vector[3:]).max()) < 1e-12


def test_a_quarter_turn_to_the_left_takes_x_to_y() -> None:
    pose = pose_of_vector([1, 2, 3, 0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    assert np.allclose(moved(np.array([[1.0, 0, 0]]), pose), [[1, 3, 3]])


@pytest.mark.parametrize("vector", [[0] * 6, [0] * 7, [0, 0, np.nan, 0, 0, 0, 1], [0, 0, 0, 0, 0, 0, 2]])
def test_what_is_no_pose_is_refused(vector: list[float]) -> None:
    with pytest.raises(Error):
        pose_of_vector(vector)


def test_what_does_not_turn_rigidly_is_refused() -> None:
    with pytest.raises(Error):
        vector_of_pose(2 * np.eye(4))
    with pytest.raises(Error):
        vector_of_pose(np.diag([1.0, 1, -1, 1]))
