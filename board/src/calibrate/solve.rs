//! Robust least squares over intrinsic parameters and poses: Levenberg-Marquardt with each pose eliminated by its Schur complement.

use super::camera::{Camera, INTRINSICS, KEPT};
use super::pose::Pose;
use super::shape::{SHAPE, Shape};
use super::sighting::Sighting;
use nalgebra::{Matrix2x3, Rotation3, SMatrix, SVector, Vector2, Vector3};

/// Number of parameters of a board's pose: three of the rotation, three of the translation.
const POSE: usize = 6;

/// Number of parameters that all pictures share: those of the camera and of the board's shape.
const SHARED: usize = INTRINSICS + SHAPE;

/// Weights of the prior of the shared parameters: inverse standard deviations, for a residual of one pixel.
const PRIOR: [f64; SHARED] =
    [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 500.0, 500.0, 20.0, 20.0, 20.0];

type Square = SMatrix<f64, SHARED, SHARED>;
type Column = SVector<f64, SHARED>;

/// The camera and the board's shape, whose parameters all pictures share.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Model {
    /// Camera that took all pictures.
    pub camera: Camera,
    /// Shape of the board, bent and sheared.
    pub shape: Shape,
    /// True if all coefficients of the radial law are fitted, false if only those are fitted that a lens file stores.
    pub rich: bool,
}

impl Model {
    fn column(&self) -> Column {
        let mut column = Column::zeros();
        column.fixed_rows_mut::<INTRINSICS>(0).copy_from(&self.camera.0);
        column.fixed_rows_mut::<SHAPE>(INTRINSICS).copy_from(&self.shape.values);
        column
    }

    fn moved(&self, step: &Column) -> Self {
        let camera = Camera(self.camera.0 + step.fixed_rows::<INTRINSICS>(0));
        let values = self.shape.values + step.fixed_rows::<SHAPE>(INTRINSICS);
        Self { camera, shape: self.shape.with(values), ..*self }
    }

    /// Calls `fix` with the index of each shared parameter that is not fitted.
    fn fix(&self, mut fix: impl FnMut(usize)) {
        self.shape.fix(|i| fix(INTRINSICS + i));
        if !self.rich {
            (KEPT..INTRINSICS).for_each(fix);
        }
    }

    /// Returns the computed pixel of the corner `cell` in a view.
    pub fn pixel(&self, view: &View, cell: [i32; 2]) -> Vector2<f64> {
        self.camera.pixel(&view.pose.apply(&self.shape.place(cell)))
    }
}

/// The corners detected in one picture and the pose of its board.
#[derive(Clone, Debug)]
pub(super) struct View {
    /// Corners of the board that were detected in the picture.
    pub seen: Vec<Sighting>,
    /// Pose of the board in the picture.
    pub pose: Pose,
}

impl View {
    /// Returns the difference between the detected and the computed pixel of each corner of the view.
    pub fn residuals<'a>(&'a self, model: &'a Model) -> impl Iterator<Item = Vector2<f64>> + 'a {
        self.seen.iter().map(|s| s.at - model.pixel(self, s.cell))
    }
}

/// Parameters of a camera that a fit varies.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Free {
    /// Intrinsic parameters, shape of the board, and poses.
    All,
    /// The poses of all boards, with a fixed camera and shape.
    Poses,
}

/// The normal equations of one picture's corners, for the shared parameters and the pose.
struct Block {
    shared: Square,
    mixed: SMatrix<f64, SHARED, POSE>,
    pose: SMatrix<f64, POSE, POSE>,
    right: Column,
    right_pose: SVector<f64, POSE>,
}

impl Block {
    fn of(view: &View, model: &Model, width: f64) -> Self {
        let mut block = Self {
            shared: Square::zeros(),
            mixed: SMatrix::zeros(),
            pose: SMatrix::zeros(),
            right: Column::zeros(),
            right_pose: SVector::zeros(),
        };
        for sighting in &view.seen {
            block.add(sighting, view, model, width);
        }
        block
    }

    fn add(&mut self, sighting: &Sighting, view: &View, model: &Model, width: f64) {
        let turned = view.pose.turn * model.shape.place(sighting.cell);
        let p = model.camera.project(&(turned + view.pose.shift));
        let residual = sighting.at - p.pixel;
        let weight = 1.0 / (1.0 + residual.norm_squared() / (width * width));
        let by_pose = by_pose(&p.by_point, turned);
        let mut by_shared = SMatrix::<f64, 2, SHARED>::zeros();
        by_shared.fixed_columns_mut::<INTRINSICS>(0).copy_from(&p.by_intrinsics);
        let by_shape = p.by_point * view.pose.turn.matrix() * model.shape.derivatives(sighting.cell);
        by_shared.fixed_columns_mut::<SHAPE>(INTRINSICS).copy_from(&by_shape);
        let weighted = by_shared.transpose() * weight;
        self.shared += weighted * by_shared;
        self.mixed += weighted * by_pose;
        self.pose += by_pose.transpose() * by_pose * weight;
        self.right += weighted * residual;
        self.right_pose += by_pose.transpose() * residual * weight;
    }

    /// Returns the matrix of the pose's normal equations with damping.
    fn damped(&self, damping: f64) -> Option<SMatrix<f64, POSE, POSE>> {
        let mut pose = self.pose;
        (0..POSE).for_each(|i| pose[(i, i)] *= 1.0 + damping);
        pose.try_inverse()
    }
}

fn by_pose(by_point: &Matrix2x3<f64>, turned: Vector3<f64>) -> SMatrix<f64, 2, POSE> {
    let mut by_pose = SMatrix::<f64, 2, POSE>::zeros();
    by_pose.fixed_columns_mut::<3>(0).copy_from(&(by_point * -turned.cross_matrix()));
    by_pose.fixed_columns_mut::<3>(3).copy_from(by_point);
    by_pose
}

/// Returns the Cauchy loss of the residuals of all corners; `width` is the residual in pixels from which corners lose weight.
pub(super) fn loss(model: &Model, views: &[View], width: f64) -> f64 {
    let scale = width * width;
    let one = |r: Vector2<f64>| scale * (r.norm_squared() / scale).ln_1p();
    let prior: f64 = model.column().iter().zip(PRIOR).map(|(value, weight)| (value * weight).powi(2)).sum();
    prior + views.iter().flat_map(|view| view.residuals(model)).map(one).sum::<f64>()
}

/// Improves the parameters `free` of a camera and its views in at most `steps` steps; returns the final loss.
pub(super) fn solve(model: &mut Model, views: &mut [View], width: f64, free: Free, steps: usize) -> f64 {
    let mut damping = 1e-3;
    let mut best = loss(model, views, width);
    for _ in 0..steps {
        let blocks: Vec<Block> = views.iter().map(|view| Block::of(view, model, width)).collect();
        let mut gained = None;
        while gained.is_none() && damping < 1e9 {
            let next = step(model, views, &blocks, damping, free);
            gained = next.and_then(|(next, moved)| {
                let now = loss(&next, &moved, width);
                (now < best).then_some((next, moved, now))
            });
            damping *= if gained.is_some() { 0.2 } else { 6.0 };
        }
        let Some((next, moved, now)) = gained else { break };
        let done = best - now < 1e-9 * best;
        *model = next;
        views.clone_from_slice(&moved);
        best = now;
        damping = f64::max(damping, 1e-9);
        if done {
            break;
        }
    }
    best
}

/// Computes one step of the fit from the normal equations.
fn step(
    model: &Model,
    views: &[View],
    blocks: &[Block],
    damping: f64,
    free: Free,
) -> Option<(Model, Vec<View>)> {
    let inverses: Vec<_> = blocks.iter().map(|block| block.damped(damping)).collect::<Option<_>>()?;
    let by_shared =
        if free == Free::All { shared_step(model, blocks, &inverses, damping)? } else { Column::zeros() };
    let moved = views.iter().zip(blocks).zip(&inverses).map(|((view, block), inverse)| {
        let step = inverse * (block.right_pose - block.mixed.transpose() * by_shared);
        let turn = Rotation3::new(step.fixed_rows::<3>(0).into_owned()) * view.pose.turn;
        let shift = view.pose.shift + step.fixed_rows::<3>(3);
        View { seen: view.seen.clone(), pose: Pose { turn, shift } }
    });
    let next = model.moved(&by_shared);
    (next.camera.focal().min() > 0.0).then(|| (next, moved.collect()))
}

fn shared_step(
    model: &Model,
    blocks: &[Block],
    inverses: &[SMatrix<f64, POSE, POSE>],
    damping: f64,
) -> Option<Column> {
    let mut normal = Square::zeros();
    let mut right = Column::zeros();
    for (block, inverse) in blocks.iter().zip(inverses) {
        let eliminated = block.mixed * inverse;
        normal += block.shared - eliminated * block.mixed.transpose();
        right += block.right - eliminated * block.right_pose;
    }
    let values = model.column();
    for (i, weight) in PRIOR.iter().enumerate() {
        normal[(i, i)] += weight * weight;
        right[i] -= values[i] * weight * weight;
    }
    model.fix(|i| fixed(&mut normal, &mut right, i));
    (0..SHARED).for_each(|i| normal[(i, i)] *= 1.0 + damping);
    normal.cholesky().map(|c| c.solve(&right))
}

/// Removes parameter `i` from the normal equations.
fn fixed(normal: &mut Square, right: &mut Column, i: usize) {
    normal.row_mut(i).fill(0.0);
    normal.column_mut(i).fill(0.0);
    normal[(i, i)] = 1.0;
    right[i] = 0.0;
}

/// Covariances of the camera's parameters in a fit that varies the poses and the board's shape too.
pub(super) struct Covariances {
    /// Covariance for independent residuals with a standard deviation of one pixel.
    pub independent: SMatrix<f64, KEPT, KEPT>,
    /// Covariance from the scatter of the views' gradients: it is larger if the corners of one picture have correlated errors, or if the
    /// lens model does not fit the lens.
    pub by_view: SMatrix<f64, KEPT, KEPT>,
}

/// Returns the covariances of the camera's parameters at the fitted `model`.
pub(super) fn covariances(model: &Model, views: &[View]) -> Option<Covariances> {
    let blocks: Vec<Block> = views.iter().map(|view| Block::of(view, model, f64::INFINITY)).collect();
    let (mut normal, mut scatter) = (Square::zeros(), Square::zeros());
    for block in &blocks {
        let eliminated = block.mixed * block.damped(0.0)?;
        normal += block.shared - eliminated * block.mixed.transpose();
        let gradient = block.right - eliminated * block.right_pose;
        scatter += gradient * gradient.transpose();
    }
    PRIOR.iter().enumerate().for_each(|(i, weight)| normal[(i, i)] += weight * weight);
    model.fix(|i| fixed(&mut normal, &mut Column::zeros(), i));
    model.fix(|i| fixed(&mut scatter, &mut Column::zeros(), i));
    let inverse = normal.try_inverse()?;
    let count = views.len() as f64;
    let scattered = inverse * scatter * inverse * (count / (count - 1.0).max(1.0));
    let kept = |all: &Square| all.fixed_view::<KEPT, KEPT>(0, 0).into_owned();
    Some(Covariances { independent: kept(&inverse), by_view: kept(&scattered) })
}
