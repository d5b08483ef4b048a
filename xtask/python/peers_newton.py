"""Newton's cloth solvers on the moving skirt: `peers_newton.py SCENE OUT.npz vbd|style3d`.

Ten substeps a frame, on the processor. A frame's time is that of collision detection and all
substeps; kernels are compiled and the graph is recorded before, on the same scene, and undone.
"""

import sys

import newton
import numpy as np
import warp as wp
from newton.solvers import style3d

from peers_scene import Clock, Scene, write

SUBSTEPS = 10
# Stiffness of contacts [N/m].
CONTACT = 1e4


@wp.kernel
def lead(
    step: wp.array(dtype=int),
    way: wp.array(dtype=wp.transform),
    pinned: wp.array(dtype=int),
    rest: wp.array(dtype=wp.vec3),
    before: wp.array(dtype=wp.transform),
    after: wp.array(dtype=wp.transform),
    q_in: wp.array(dtype=wp.vec3),
    q_out: wp.array(dtype=wp.vec3),
):
    """Takes body and waist from the end of the last substep to that of this one."""
    i = wp.tid()
    k = step[0]
    x = wp.transform_point(way[k + 1], rest[i])
    q_in[pinned[i]] = x
    q_out[pinned[i]] = x
    if i == 0:
        before[0] = way[k]
        after[0] = way[k + 1]


@wp.kernel
def count(step: wp.array(dtype=int)):
    step[0] = step[0] + 1


def add_cloth(builder, scene, solver):
    """The skirt in the reference material."""
    m = scene.material
    stretch, poisson = m["stretch_n_m"], m["poisson"]
    where = {
        "pos": wp.vec3(0.0),
        "rot": wp.quat_identity(),
        "vel": wp.vec3(0.0),
        "scale": 1.0,
        "vertices": scene.cloth.tolist(),
        "indices": scene.faces.ravel().tolist(),
        "density": m["density_kg_m2"],
        "particle_radius": m["apart_m"],
    }
    if solver == "vbd":
        # Lamé's constants of a sheet in plane stress; bending is set edge by edge later.
        mu, lam = stretch / (2 * (1 + poisson)), stretch * poisson / (1 - poisson**2)
        builder.add_cloth_mesh(**where, tri_ke=mu, tri_ka=lam, tri_kd=0.0, edge_ke=1.0, edge_kd=0.0)
        return
    style3d.add_cloth_mesh(
        builder,
        **where,
        panel_verts=scene.flat().reshape(-1, 2).tolist(),
        panel_indices=list(range(scene.faces.size)),
        tri_aniso_ke=wp.vec3(stretch, stretch, m["shear_n_m"]),
        edge_aniso_ke=wp.vec3(m["bend_n_m"] / 3),
    )


def model(scene, solver):
    """Cloth, held at the waist, and a body that others move."""
    m = scene.material
    builder = newton.ModelBuilder(up_axis=newton.Axis.Y, gravity=scene.gravity)
    if solver == "style3d":
        newton.solvers.SolverStyle3D.register_custom_attributes(builder)
    add_cloth(builder, scene, solver)
    body = builder.add_body(is_kinematic=True)
    shape = newton.ModelBuilder.ShapeConfig(ke=CONTACT, kd=0.0, mu=m["friction"])
    builder.add_shape_mesh(body, mesh=newton.Mesh(scene.body, scene.body_faces.ravel()), cfg=shape)
    builder.color(include_bending=True)
    made = builder.finalize(device="cpu")
    bend(made, m["bend_n_m"], solver)
    flags = made.particle_flags.numpy()
    flags[scene.pinned] &= ~int(newton.ParticleFlags.ACTIVE)
    made.particle_flags.assign(flags)
    made.soft_contact_ke, made.soft_contact_kd = CONTACT, 0.0
    made.soft_contact_mu = m["friction"]
    return made


def bend(made, stiffness, solver):
    """The same bending for every edge, however long and whatever its direction; flat at rest."""
    x, edges = made.particle_q.numpy(), made.edge_indices.numpy()
    inner = edges[:, :2].min(axis=1) >= 0
    a, b, c, d = (x[edges[:, k]] for k in range(4))
    long = np.linalg.norm(d - c, axis=1)
    area = 0.5 * sum(np.linalg.norm(np.cross(d - c, p - c), axis=1) for p in (a, b))
    # VBD's figure is a torque per edge; Style3D's quadratic law bends like a plate of three times it.
    own = stiffness * long / area if solver == "vbd" else stiffness / 3
    values = made.edge_bending_properties.numpy()
    values[:, 0] = np.where(inner, own, 0.0)
    made.edge_bending_properties.assign(values)
    made.edge_rest_angle.zero_()


class Run:
    """A solver on its way through the scene."""

    def __init__(self, scene, solver):
        self.model = model(scene, solver)
        self.solver = self.make(solver, scene.material["apart_m"])
        self.vbd = solver == "vbd"
        # Contacts are looked for in every substep, for the body moves.
        self.pipeline = newton.CollisionPipeline(self.model)
        self.contacts = self.pipeline.contacts()
        self.states = [self.model.state(), self.model.state()]
        self.control = self.model.control()
        places = [scene.at(s / SUBSTEPS) for s in range(scene.frames * SUBSTEPS + 1)]
        self.way = wp.array([[*way, *turn] for way, turn in places], dtype=wp.transform)
        self.pinned = wp.array(scene.pinned, dtype=int)
        self.rest = wp.array(scene.cloth[scene.pinned], dtype=wp.vec3)
        self.step = wp.zeros(1, dtype=int)
        self.start = self.model.particle_q.numpy().copy()

    def make(self, solver, apart):
        if solver == "style3d":
            config = newton.solvers.SolverStyle3D.Config(iterations=4, linear_iterations=10)
            return newton.solvers.SolverStyle3D(self.model, config=config)
        return newton.solvers.SolverVBD(
            self.model,
            iterations=10,
            integrate_with_external_rigid_solver=True,
            particle_enable_self_contact=True,
            particle_self_contact_margin=apart,
            particle_self_contact_gap=apart,
        )

    def again(self):
        """Back to the start."""
        self.step.zero_()
        for state in self.states:
            state.particle_q.assign(self.start)
            state.particle_qd.zero_()

    def frame(self):
        if self.vbd:
            self.solver.rebuild_bvh(self.states[0])
        for _ in range(SUBSTEPS):
            a, b = self.states
            a.clear_forces()
            wp.launch(
                lead,
                dim=len(self.pinned),
                inputs=[self.step, self.way, self.pinned, self.rest],
                outputs=[a.body_q, b.body_q, a.particle_q, b.particle_q],
            )
            self.pipeline.collide(a, self.contacts)
            self.solver.step(a, b, self.control, self.contacts, self.dt)
            wp.launch(count, dim=1, outputs=[self.step])
            self.states = [b, a]

    def all(self, scene):
        self.dt = 1.0 / (scene.fps * SUBSTEPS)
        self.frame()
        self.again()
        graph = None
        if self.vbd:
            # Style3D asks the host for dot products, which no graph can hold.
            with wp.ScopedCapture() as capture:
                self.frame()
            graph = capture.graph
            self.again()
        clock, cloth = Clock(), [self.start]
        for _ in range(scene.frames):
            with clock:
                wp.capture_launch(graph) if graph else self.frame()
                wp.synchronize()
            cloth.append(self.states[0].particle_q.numpy().copy())
        return clock, cloth


def main(folder, out, solver):
    wp.config.quiet = True
    wp.set_device("cpu")
    scene = Scene(folder)
    clock, cloth = Run(scene, solver).all(scene)
    versions = {"newton": newton.__version__, "warp": wp.__version__}
    write(out, scene, cloth, clock, versions)


if __name__ == "__main__":
    main(*sys.argv[1:4])
