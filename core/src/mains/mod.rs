//! Removes the flicker of lamps on the mains from the map of each burst.
//!
//! A lamp on the mains varies 100 or 120 times a second. An exposure of a millisecond, in which a lamp is not clipped, records one phase of
//! the lamp, so the map differs from burst to burst. A mean and three harmonics are fitted to the energies of each cell of the map at the
//! times of the last bursts, and the mean replaces the energy. The merge is linear and a burst's frames have fixed times relative to each
//! other, so the fit applies to the merged map whichever exposures of a cell are valid.
//!
//! A lamp that is valid in several exposures at some phases and in one at others has a waveform that no frequency explains. If the light varies
//! widely and no frequency is found, the next sixteen bursts are to be merged without such exposures ([`Mains::keeps`]).
//!
//! Cells without significant modulation are not changed. An abrupt change of a cell's energy restarts its fit; until the fit is determined,
//! the values are divided by the modulation of the former fit.
//!
//! ```
//! use hemilux_core::mains::{Cell, Lamps, Mains, mains_len};
//! use hemilux_core::pyramid::{Pyramid, Quad, pyramid_len};
//! use hemilux_core::{Domain, Order, healpix};
//!
//! let order = Order::try_new(3)?;
//! let mut map = Pyramid::try_new(vec![Quad::default(); pyramid_len(Domain::Hemisphere, order)], Domain::Hemisphere, order)?;
//! let mut mains = Mains::try_new(order, Lamps::Auto, vec![Cell::default(); mains_len(order)])?;
//! let towards = healpix::centre(3, 100).as_vec3();
//! for burst in 0..20 {
//!     let seconds = f64::from(burst) * 3.0 / 28.0;
//!     let lamp = 1.0 + (core::f64::consts::TAU * 100.0 * seconds).cos();
//!     map.texels_mut()[100] = Quad::from_light([lamp as f32; 3], towards);
//!     map.build();
//!     let found = mains.update(&mut map, Some(seconds));
//!     if burst > 10 {
//!         assert!((map.view().total().y() - 1.0).abs() < 0.01);
//!         assert!((found.frequency_hz.unwrap() - 100.0).abs() < 0.3);
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod cell;
mod fit;
mod frequency;
mod rate;
mod replace;
mod search;
mod window;

use crate::buffer::{self, Buffer, TooSmall};
use crate::healpix::{Domain, Order};
use crate::pyramid::{Pyramid, Quad};
pub use cell::Cell;
use cell::{FIT_EVERY, Fits, Level};
pub use frequency::Lamps;
use frequency::Lock;
pub use rate::{best_rate, best_rate_of_any, whole_periods};
use replace::{CellIndex, replace};
use search::Search;
use window::{WINDOW, Window};

/// Difference between the orders of a cell and of the region that contains it.
const REGION: u8 = 2;

/// Finest HEALPix order of cells; the texels of a finer map are combined to cells of this order.
const FINEST: u8 = 5;

/// Longest time between two bursts that one fit spans, seconds.
const LONGEST_GAP_S: f64 = 1.0;

/// Largest amplitude that an exposure may record of a modulation of amplitude 1, if it is to be merged in addition to the shortest and the
/// longest exposure.
const MOST_RESPONSE: f64 = 0.25;

/// Weight of the newest burst in the mean colour of a cell.
const NEW_COLOUR: f32 = 1.0 / 8.0;

/// The modulation of the light that was removed from a map.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Flicker {
    /// Frequency of the modulation, hertz; `None` without a modulation, and for bursts without times.
    pub frequency_hz: Option<f32>,
    /// Amplitude of the modulation relative to the mean, 0..=1, averaged over the corrected cells.
    pub depth: f32,
    /// Fraction of the map's luminance energy that is an estimate over several bursts, 0..=1.
    pub share: f32,
}

impl Flicker {
    /// The value for a map without modulation.
    pub const NONE: Self = Self { frequency_hz: None, depth: 0.0, share: 0.0 };
}

/// Returns the HEALPix order of the cells for a map of `order`.
const fn cell_order(order: Order) -> u8 {
    if order.get() > FINEST { FINEST } else { order.get() }
}

/// Returns the HEALPix order of the regions for cells of `order`.
const fn region_order(order: u8) -> u8 {
    order.saturating_sub(REGION)
}

/// Returns the number of [`Cell`]s that [`Mains::try_new`] needs for hemisphere maps of `order`.
#[must_use]
pub const fn mains_len(order: Order) -> usize {
    let cells = cell_order(order);
    Domain::Hemisphere.quads(cells) + Domain::Hemisphere.quads(region_order(cells))
}

/// Removes the flicker of lamps from the maps of successive bursts.
#[derive(Clone, Debug)]
pub struct Mains<B> {
    state: MainsState,
    cells: B,
}

/// The state of [`Mains`] without its cells.
#[derive(Clone, Copy, Debug)]
struct MainsState {
    /// HEALPix order of the cells whose light is fitted.
    order: u8,
    lamps: Lamps,
    window: Window,
    has_times: bool,
    /// The time that the caller stated for the last burst, seconds.
    stated: Option<f64>,
    lock: Option<Lock>,
    search: Search,
    /// Number of the last burst before a change of the merged exposures by [`Mains::reselect`].
    reselected: Option<u32>,
    /// Number of bursts of [`Mains::update_apart`] since the newest burst of the window.
    apart: u32,
}

impl<B: Buffer<Cell>> Mains<B> {
    /// Creates the stage for hemisphere maps of `order`; `cells` needs [`mains_len`] elements.
    ///
    /// # Errors
    /// [`TooSmall`] if `cells` has too few elements.
    pub fn try_new(order: Order, lamps: Lamps, mut cells: B) -> Result<Self, TooSmall> {
        buffer::check(&cells, mains_len(order))?;
        cells.as_mut().fill(Cell::default());
        let order = cell_order(order);
        Ok(Self {
            state: MainsState {
                order,
                lamps,
                window: Window::default(),
                has_times: true,
                stated: None,
                lock: None,
                search: Search::default(),
                reselected: None,
                apart: 0,
            },
            cells,
        })
    }

    /// Sets the lamps whose frequency is searched. If `lamps` differ from the former lamps, all earlier bursts are discarded.
    pub fn set_lamps(&mut self, lamps: Lamps) {
        if self.state.lamps != lamps {
            self.state.lamps = lamps;
            self.restart();
        }
    }

    /// Discards the light of all earlier bursts.
    pub fn restart(&mut self) {
        self.state.restart(self.cells.as_mut());
    }

    /// Discards the modulation of each cell, because the next bursts are merged from other exposures than the earlier bursts, in which a lamp has
    /// another modulation. A known frequency and its phase are kept.
    pub fn refit(&mut self) {
        if self.state.lock.is_none() {
            return self.restart();
        }
        let since = self.state.window.number();
        for cell in self.cells.as_mut() {
            *cell = Cell { past: cell.past, colour: cell.colour, since, ..Cell::default() };
        }
    }

    /// States that the next bursts are merged without exposures for which [`Mains::keeps`] has become false, or with them again. The modulation of a
    /// cell that was valid in these exposures changes, so that a cell whose energy changes abruptly is fitted again without its former
    /// modulation; the fits of other cells are kept. Without a known frequency, the light of all earlier bursts is discarded.
    pub fn reselect(&mut self) {
        if self.state.lock.is_none() {
            return self.restart();
        }
        self.state.reselected = Some(self.state.window.number());
    }

    /// Returns whether the next burst is to be merged with an exposure of `seconds` that is neither its shortest nor its longest.
    ///
    /// While a frequency is locked, exposures much shorter than its period, or between its multiples, are left out: a bright cell would be
    /// valid in them at some phases and clipped at others, so that the phase would affect the merged light by more than the lamp's modulation.
    /// The same exposures are left out of some bursts if the light varies widely and no frequency explains it.
    #[must_use]
    pub fn keeps(&self, seconds: f64) -> bool {
        let hz = match self.state.lock {
            Some(lock) if self.state.has_times => [lock.frequency; 2],
            None if !self.state.search.is_on() => return true,
            _ => frequency::LAMPS_HZ,
        };
        hz.iter().all(|hz| frequency::response(hz * seconds) < MOST_RESPONSE)
    }

    /// Processes the map of the next burst and removes the modulation over the last bursts. `at` is the time of the burst's shortest exposure in
    /// seconds, from any origin; `None` for bursts at equal, unknown intervals, for which no frequency is returned. A time that does not differ
    /// from that of the last burst counts as `None`.
    ///
    /// A map without significant modulation, and a map of another domain or order, is not changed.
    pub fn update<Q: Buffer<Quad>>(&mut self, map: &mut Pyramid<Q>, at: Option<f64>) -> Flicker {
        if !self.accepts(map) {
            return Flicker::default();
        }
        let cells = self.cells.as_mut();
        self.state.remember(map, at, cells);
        match self.state.follow(cells) {
            Some(lock) => {
                let fits = self.state.fits_at(&lock);
                self.state.replace_levels(map, &lock, cells, |cell, in_region, due| {
                    fits.level(cell, in_region, due)
                })
            }
            None => Flicker::default(),
        }
    }

    /// Processes the map of a burst that lacks exposures of the other bursts: replaces the energy of each modulated cell by its mean in the last
    /// burst of [`Mains::update`]. The light of the burst is not stored, because the modulation of a lamp differs with the exposures.
    ///
    /// A change of a modulated lamp in such a burst is followed from the next burst of [`Mains::update`] on.
    pub fn update_apart<Q: Buffer<Quad>>(&mut self, map: &mut Pyramid<Q>) -> Flicker {
        if !self.accepts(map) {
            return Flicker::default();
        }
        self.state.apart = self.state.apart.saturating_add(1);
        match self.state.lock {
            Some(lock) => {
                let fits = self.state.fits_at(&lock);
                self.state.replace_levels(map, &lock, self.cells.as_mut(), |cell, in_region, _| {
                    let mut copy = *cell;
                    fits.level(&mut copy, in_region, false).filter(|level| level.is_modulated)
                })
            }
            None => Flicker::default(),
        }
    }

    /// Returns whether lamps are searched in maps of the domain and order of `map`.
    fn accepts<Q: Buffer<Quad>>(&self, map: &Pyramid<Q>) -> bool {
        let view = map.view();
        let is_other = view.domain() != Domain::Hemisphere || cell_order(view.order()) != self.state.order;
        self.state.lamps != Lamps::Off && !is_other
    }
}

/// Sums over the cells that were corrected.
#[derive(Default)]
struct Corrected {
    energy: f32,
    modulation: f32,
    cells: usize,
}

/// The memory of [`Mains`], divided into cells and regions.
struct Divided<'a> {
    cells: &'a mut [Cell],
    regions: &'a mut [Cell],
}

impl MainsState {
    fn restart(&mut self, cells: &mut [Cell]) {
        (self.window, self.lock, self.reselected) = (Window::default(), None, None);
        cells.fill(Cell::default());
    }

    /// Divides memory into the cells and the regions, which follow the cells.
    fn divide<'a>(&self, cells: &'a mut [Cell]) -> Divided<'a> {
        let (cells, rest) =
            cells.split_at_mut_checked(Domain::Hemisphere.quads(self.order)).unwrap_or_default();
        let regions = Domain::Hemisphere.quads(region_order(self.order));
        Divided { cells, regions: rest.get_mut(..regions).unwrap_or_default() }
    }

    /// Adds a burst to the window and its energies to the cells and regions.
    fn remember<Q: Buffer<Quad>>(&mut self, map: &Pyramid<Q>, at: Option<f64>, cells: &mut [Cell]) {
        // A time that does not advance from burst to burst counts as no time.
        let at = at.filter(|at| self.stated.replace(*at) != Some(*at));
        let has_times = at.is_some();
        let last = self.window.last();
        let apart = f64::from(core::mem::take(&mut self.apart));
        let at = at.unwrap_or_else(|| last.map_or(0.0, |last| last + 1.0 + apart));
        let gap = last.map_or(0.0, |last| at - last);
        let follows = last.is_none() || (gap > 0.0 && (gap < LONGEST_GAP_S || !has_times));
        if !follows || has_times != self.has_times {
            self.restart(cells);
        }
        self.has_times = has_times;
        self.window.push(at);
        let (slot, view) = (self.window.slot(0), map.view());
        let Divided { cells, regions } = self.divide(cells);
        let quads = view.quads_of(self.order);
        let of_regions = view.quads_of(region_order(self.order));
        regions.iter_mut().zip(of_regions).for_each(|(region, quad)| region.past[slot] = quad.y());
        cells.iter_mut().zip(quads).for_each(|(cell, quad)| cell.past[slot] = quad.y());
        if self.lock.is_some() {
            for (cell, quad) in cells.iter_mut().zip(quads) {
                cell.colour.iter_mut().zip(quad.rgb()).for_each(|(sum, v)| *sum += NEW_COLOUR * (v - *sum));
            }
        }
    }

    /// Searches the frequency of the modulation, or follows the drift of the locked frequency.
    fn follow(&mut self, cells: &mut [Cell]) -> Option<Lock> {
        let window = self.window;
        let regions = self.divide(cells).regions;
        self.lock = match self.lock.take() {
            Some(mut lock) => {
                lock.advance(&window);
                lock.follow(&window, regions)
            }
            None => frequency::find(&window, regions, self.lamps, self.has_times),
        };
        let is_found = self.lock.is_some();
        self.search.advance(is_found, || frequency::varies_widely(&window, regions));
        self.lock
    }

    fn fits_at(&self, lock: &Lock) -> Fits {
        let is_reselected = self.reselected.is_some_and(|since| self.window.age(since) < WINDOW);
        Fits::new(&self.window, lock.phase, lock.frequency, is_reselected)
    }

    /// Replaces the energy of each cell for which `level` returns one; its second argument is whether the cell's region is modulated, its third
    /// whether the cell is due for a fit.
    fn replace_levels<Q: Buffer<Quad>>(
        &self,
        map: &mut Pyramid<Q>,
        lock: &Lock,
        cells: &mut [Cell],
        level: impl Fn(&mut Cell, bool, bool) -> Option<Level>,
    ) -> Flicker {
        let Divided { cells, regions } = self.divide(cells);
        let (order, mut sums) = (self.order, Corrected::default());
        let below = 2 * map.view().order().get().saturating_sub(order);
        let many = 1 << (2 * (order - region_order(order)));
        for (region, (index, cells)) in regions.iter_mut().zip(cells.chunks_mut(many).enumerate()) {
            let first = many * index;
            let in_region = level(region, false, true).is_some();
            if !in_region && !region.has_shape() {
                continue;
            }
            for (index, cell) in cells.iter_mut().enumerate() {
                let due = (index + self.window.number() as usize).is_multiple_of(FIT_EVERY);
                let Some(level) = level(cell, in_region, due) else { continue };
                let texels = ((first + index) << below)..((first + index + 1) << below);
                let Some(texels) = map.texels_mut().get_mut(texels) else { continue };
                replace(texels, &level, cell, CellIndex { order, cell: (first + index) as u32 });
                sums.add(&level);
            }
        }
        if sums.cells > 0 {
            map.build();
        }
        let share = sums.energy / map.view().total().y().max(f32::MIN_POSITIVE);
        let frequency_hz = self.has_times.then_some(lock.frequency as f32);
        let depth = sums.modulation / sums.energy.max(f32::MIN_POSITIVE);
        Flicker { frequency_hz, depth: depth.min(1.0), share: share.min(1.0) }
    }
}

impl Corrected {
    fn add(&mut self, level: &Level) {
        self.cells += 1;
        if level.is_modulated {
            self.energy += level.y;
            self.modulation += level.y * level.depth;
        }
    }
}
