//! Black surfaces that emit: their light is given to the others before anything is solved.
//!
//! With ρ = 0 a lamp k has B_k = E_k, whatever arrives. What its light alone makes of the other elements is known, so that for these
//!
//! ```text
//! h_s = (1/A_s) Σ_k A_k F_ks E_k,      B_s = (E_s + ρ_s h_s) + ρ_s (1/A_s) Σ_t A_s F_st B_t,      H_s = h_s + (1/A_s) Σ_t A_s F_st B_t,
//! ```
//!
//! a system of its own with another emission, whose power is no more than the scene's: to the same unshot share of it the answer is at least as near, and its bounds hold of the
//! scene as well. H of lamps is gathered once, from the same form factors, which are held in between, and from those among lamps. Pairs are computed as often as in one system of all.
//! A test sees both answers within 1e-12, and the counts that are predicted.
//!
//! What is *not* here, where lamps stay unknowns: rows of rays and hemicubes, and elements that gather from patches, which see lamps together with all else; rooms in which nothing
//! reflects; errors that are bounded, since what drops pairs spares those with emitters and what drops bounces counts from the light of lamps on; and rooms whose faces mirror each
//! other where rows are copied: a lamp that is out of the system takes the symmetries with it that map it onto a wall, and in a cube one pair in 48 is computed, not one in 8.

use std::time::Instant;

use radiosity_core::{BandValues, Cost, FormFactors as _};
use radiosity_form_factors::stores::DenseFormFactors;

use super::follow::{Selection, System, among, elements_of, places, selected_rows};
use super::{Plan, Role};
use crate::geometry::Given;
use crate::{Geometry, Phase, RunError, Strategy};

/// Lamps of all rooms in which something is solved.
pub(super) struct Lamps {
    rooms: Vec<Room>,
    /// What their form factors took.
    pub(super) form_factors: Phase,
}

/// Lamps of one room, and what they shine on.
pub(super) struct Room {
    /// Elements of lamps, by their numbers among all that is exposed.
    pub(super) lamps: Vec<u32>,
    /// E of lamps in the solved bands.
    pub(super) emission: BandValues,
    senders: Vec<u32>,
    /// Exchange areas from lamps to senders.
    store: DenseFormFactors,
    /// Exchange areas of lamps among each other.
    mutual: DenseFormFactors,
}

impl Lamps {
    /// The lamps of `plan`, with their form factors.
    pub(super) fn new(
        plan: &Plan,
        whole: &Geometry<'_>,
        systems: &[System<'_>],
        strategy: &Strategy,
    ) -> Result<Self, RunError> {
        let clock = Instant::now();
        let (surfaces, mut rooms, mut cost) = (whole.surfaces(), Vec::new(), Cost::default());
        for System { room, part, selection, .. } in systems {
            let in_room = |s: usize| plan.room[s] == *room;
            let lamps = elements_of(&surfaces, &|s| in_room(s) && plan.roles[s] == Role::Shines);
            if lamps.is_empty() {
                continue;
            }
            let own = among(whole.part(&lamps, &plan.bands.solved, false), strategy, &in_room);
            let own_selection = Selection::new(whole, &own, lamps);
            let from = (own.elements(), &*own_selection.elements);
            let (store, spent) =
                DenseFormFactors::assemble(&*selected_rows(whole, (part, selection), Some(from), strategy)?)?;
            cost += spent;
            // The same rows go on to the other lamps.
            let (mutual, spent) =
                DenseFormFactors::assemble(&*selected_rows(whole, (&own, &own_selection), None, strategy)?)?;
            cost += Cost { source_evaluations: 0, ..spent };
            let (emission, senders) = (own.emission(), selection.elements.clone());
            rooms.push(Room { lamps: own_selection.elements, emission, senders, store, mutual });
        }
        Ok(Self { rooms, form_factors: Phase { cost, time: clock.elapsed() } })
    }

    pub(super) fn rooms(&self) -> &[Room] {
        &self.rooms
    }

    /// Bytes of form factors that are held.
    pub(super) fn stored_bytes(&self) -> u64 {
        let of = |room: &Room| [&room.store, &room.mutual].map(|store| store.properties().stored_bytes);
        self.rooms.iter().flat_map(of).sum()
    }

    /// Their light on the `unknowns`, in so many solved bands, `None` if there are no lamps; and what that took.
    pub(super) fn light(
        &self,
        whole: &Geometry<'_>,
        unknowns: &[u32],
        bands: usize,
    ) -> Result<(Option<Given>, Cost), RunError> {
        let mut cost = Cost::default();
        if self.rooms.is_empty() {
            return Ok((None, cost));
        }
        let mut irradiance = BandValues::zeros(bands, unknowns.len());
        let mut exchange = vec![0.0; unknowns.len()];
        for room in &self.rooms {
            // The last band has 1 everywhere, so that sums of columns come with the light.
            let n = room.lamps.len();
            let sent = room.emission.values().iter().copied().chain(std::iter::repeat_n(1.0, n)).collect();
            let sent = BandValues::new(sent, n);
            let mut sums = BandValues::zeros(bands + 1, room.senders.len());
            cost += room.store.scatter(sent.view(), sums.view_mut())?;
            for (k, &e) in places(&room.senders, unknowns).iter().enumerate() {
                let area = whole.elements().area(unknowns[e as usize] as usize);
                (0..bands).for_each(|b| irradiance.band_mut(b)[e as usize] = sums.band(b)[k] / area);
                exchange[e as usize] = sums.band(bands)[k];
            }
        }
        Ok((Some(Given { irradiance, exchange }), cost))
    }
}

impl Room {
    /// H of the lamps, from the radiosity of all elements in the solved bands and from each other; and what that took.
    pub(super) fn arriving(
        &self,
        whole: &Geometry<'_>,
        radiosity: &BandValues,
    ) -> Result<(BandValues, Cost), RunError> {
        let bands = radiosity.count();
        let sent = (0..bands).flat_map(|b| self.senders.iter().map(move |&e| radiosity.band(b)[e as usize]));
        let sent = BandValues::new(sent.collect(), self.senders.len());
        let mut h = BandValues::zeros(bands, self.lamps.len());
        let mut cost = self.store.gather(sent.view(), h.view_mut())?;
        let mut of_lamps = BandValues::zeros(bands, self.lamps.len());
        cost += self.mutual.gather(self.emission.view(), of_lamps.view_mut())?;
        for b in 0..bands {
            let arriving = h.band_mut(b).iter_mut().zip(of_lamps.band(b)).zip(&self.lamps);
            arriving.for_each(|((h, more), &e)| *h = (*h + more) / whole.elements().area(e as usize));
        }
        Ok((h, cost))
    }
}
