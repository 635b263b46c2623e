"""The adjustment of 28 cameras to 3,000 points by SciPy and by Ceres: same minimum as ours, and how fast.

    FARFIELD_SIDE_BY_SIDE=DIR cargo test --release -p farfield-calibration --test side_by_side -- --nocapture
    pip install numpy scipy pyceres
    python3 tests/readers/adjustment.py DIR/problem.json

Not in CI: SciPy takes minutes. Exits with 1 if a minimum differs from ours by more than one in a million.
"""

import json
import resource
import sys
import time

import numpy as np
from scipy.optimize import least_squares
from scipy.sparse import coo_matrix
from scipy.spatial.transform import Rotation


def read(path):
    problem = json.load(open(path))
    seen = np.array(problem["observations"])
    return (
        problem,
        np.array(problem["cameras"]),
        np.array(problem["points"]),
        seen[:, 0].astype(int),
        seen[:, 1].astype(int),
        seen[:, 2:],
    )


def project(problem, cameras, points):
    """Pixels of `points`, each in the camera of its row."""
    local = Rotation.from_rotvec(cameras[:, :3]).apply(points - cameras[:, 3:6])
    plane = local[:, :2] / local[:, 2:]
    square = (plane**2).sum(axis=1, keepdims=True)
    bent = plane * (1 + square * (problem["k1"] + square * problem["k2"]))
    return bent * problem["focal_px"] * cameras[:, 6:] + problem["middle_px"]


def by_scipy(problem, cameras, points, camera_of, point_of, px):
    split = cameras.size

    def residuals(x):
        found = project(problem, x[:split].reshape(-1, 7)[camera_of], x[split:].reshape(-1, 3)[point_of])
        return ((found - px) / problem["sigma_px"]).ravel()

    rows = np.arange(len(px))
    cells = []
    for axis in range(2):
        cells += [(2 * rows + axis, 7 * camera_of + k) for k in range(7)]
        cells += [(2 * rows + axis, split + 3 * point_of + k) for k in range(3)]
    row, column = (np.concatenate(part) for part in zip(*cells))
    pattern = coo_matrix((np.ones(len(row)), (row, column)), shape=(2 * len(px), split + points.size))
    start = np.concatenate([cameras.ravel(), points.ravel()])
    found = least_squares(
        residuals, start, jac_sparsity=pattern.tocsr(), method="trf", x_scale="jac", ftol=1e-12, xtol=1e-14, gtol=1e-12, max_nfev=200
    )
    return found.cost, found.nfev


def by_ceres(problem, cameras, points, camera_of, point_of, px):
    import pyceres

    class Sight(pyceres.CostFunction):
        """One observation, with numerical derivatives: slow in Python, but the minimum is the same."""

        def __init__(self, px):
            super().__init__()
            self.px = px
            self.set_num_residuals(2)
            self.set_parameter_block_sizes([7, 3])

        def Evaluate(self, parameters, residuals, jacobians):
            camera, point = np.array(parameters[0]), np.array(parameters[1])
            both = np.concatenate([camera, point])
            # Each number shifted up and down.
            steps = 1e-6 * np.maximum(1.0, np.abs(both))
            moved = np.vstack([both, both + np.diag(steps), both - np.diag(steps)])
            found = (project(problem, moved[:, :7], moved[:, 7:]) - self.px) / problem["sigma_px"]
            residuals[:] = found[0]
            if jacobians is not None:
                derivative = ((found[1:11] - found[11:]) / (2 * steps[:, None])).T
                if jacobians[0] is not None:
                    jacobians[0][:] = derivative[:, :7].ravel()
                if jacobians[1] is not None:
                    jacobians[1][:] = derivative[:, 7:].ravel()
            return True

    cameras, points = [row.copy() for row in cameras], [row.copy() for row in points]
    sights = [Sight(at) for at in px]
    solver = pyceres.Problem()
    for sight, camera, point in zip(sights, camera_of, point_of):
        solver.add_residual_block(sight, None, [cameras[camera], points[point]])
    options = pyceres.SolverOptions()
    options.linear_solver_type = pyceres.LinearSolverType.DENSE_SCHUR
    options.function_tolerance = 1e-12
    options.max_num_iterations = 50
    options.num_threads = 1
    summary = pyceres.SolverSummary()
    pyceres.solve(options, solver, summary)
    return summary.final_cost, summary.num_successful_steps


def main():
    problem, *rest = read(sys.argv[1])
    solvers = {"scipy": by_scipy, "ceres": by_ceres}
    wrong = False
    for name in sys.argv[2:] or solvers:
        began = time.time()
        cost, steps = solvers[name](problem, *rest)
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        apart = cost / problem["cost"] - 1
        wrong |= abs(apart) > 1e-6
        print(f"{name}: cost {cost:.12e}, {apart:+.1e} of ours, {steps} steps, {time.time() - began:.1f} s, at most {most:.0f} MB")
    return int(wrong)


if __name__ == "__main__":
    sys.exit(main())
