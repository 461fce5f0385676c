//! The polar map of a pipeline, for the samplers and clients that need it.

use crate::samplers::{self, Shape};
use hemilux_core::Order;
use hemilux_core::polar::{Grid, LatLong, PolarTable, Share, shares_len};
use hemilux_core::pyramid::PyramidView;
use std::sync::{Arc, Mutex, PoisonError, Weak};

type ShareTable = PolarTable<Vec<Share>>;

/// A latitude-longitude map, and the table by which it is computed from the quads.
pub(crate) struct Polar {
    pub map: LatLong<Vec<[f32; 3]>>,
    plan: Arc<ShareTable>,
}

/// The share table that this process uses: its computation is slow, and it depends on grid and order alone.
static KNOWN: Mutex<Option<Known>> = Mutex::new(None);

struct Known {
    shape: (Grid, u8),
    plan: Weak<ShareTable>,
}

/// Returns the share table for `grid` and `order`: the one in use if it fits, else a new one.
fn plan(grid: &Grid, order: u8) -> Arc<ShareTable> {
    let mut known = KNOWN.lock().unwrap_or_else(PoisonError::into_inner);
    let shape = (*grid, order);
    if let Some(plan) = known.as_ref().filter(|k| k.shape == shape).and_then(|k| k.plan.upgrade()) {
        return plan;
    }
    let shares = vec![Share::default(); shares_len(grid, Order::saturating(order))];
    let plan = Arc::new(
        PolarTable::try_new(grid, Order::saturating(order), shares)
            .expect("as many shares as the plan names"),
    );
    *known = Some(Known { shape, plan: Arc::downgrade(&plan) });
    plan
}

impl Polar {
    pub fn new(shape: &Shape) -> Self {
        let grid = &shape.grid;
        let map = LatLong::try_new(*grid, vec![[0.0; 3]; grid.len()]);
        Self {
            map: map.expect("as many texels as the grid has"),
            plan: plan(grid, samplers::polar_order(shape.order)),
        }
    }

    pub fn fill(&mut self, pyramid: &PyramidView<'_>) {
        self.map.fill(&self.plan, pyramid);
    }
}
