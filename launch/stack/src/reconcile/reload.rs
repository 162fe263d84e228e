//! Reload: applies the difference between two lists of services.

use sg_proto::launch::{Change, Difference};

use super::model::{Action, Time};
use super::reconciler::{Goal, Reconciler};
use super::slot::{AfterStop, Occupant, Slot, Stage, State};
use crate::file::{Service, Start};

impl Reconciler {
    /// Effect of [`super::model::Event::SetServices`] on each service, in the order of the list. Removed services come
    /// last.
    #[must_use]
    pub fn differences(&self, services: &[Service]) -> Vec<Difference> {
        let difference = |name: &str, (change, swap): (Change, u64)| Difference {
            service: name.to_owned(),
            change: change.into(),
            swap,
        };
        let of = |s: &Service| self.slot(&s.name).map_or((Change::Added, 0), |(_, slot)| slot.difference(s));
        let removed = self.slots.iter().filter(|s| !s.removed && !services.iter().any(|n| n.name == s.service.name));
        let listed = services.iter().map(|s| difference(&s.name, of(s)));
        listed.chain(removed.map(|s| difference(&s.service.name, (Change::Removed, 0)))).collect()
    }

    fn slot(&self, name: &str) -> Option<(usize, &Slot)> {
        self.slots.iter().enumerate().find(|(_, s)| s.service.name == name)
    }

    pub(super) fn set_services(&mut self, services: Vec<Service>, now: Time, actions: &mut Vec<Action>) {
        if self.goal != Goal::Run {
            return;
        }
        let removed = |s: &Slot| !s.removed && !services.iter().any(|n| n.name == s.service.name);
        let removed: Vec<_> =
            self.slots.iter().enumerate().filter(|(_, s)| removed(s)).map(|(index, _)| index).collect();
        for index in &removed {
            self.remove(*index, now, actions);
        }
        let mut listing = Vec::new();
        for service in services {
            let index = match self.slot(&service.name).map(|(index, _)| index) {
                Some(index) => {
                    self.change(index, service, now, actions);
                    index
                }
                None => {
                    self.slots.push(Slot::new(service));
                    actions.push(Action::Announce { service: self.slots.len() - 1 });
                    self.slots.len() - 1
                }
            };
            listing.push(index);
        }
        listing.extend(self.slots.iter().enumerate().filter(|(_, s)| s.removed).map(|(index, _)| index));
        self.listing = listing;
    }

    fn remove(&mut self, index: usize, now: Time, actions: &mut Vec<Action>) {
        self.cancel_swap(index, "the service was removed", now, actions);
        self.stop((index, Occupant::Serving), AfterStop::Stay, now, actions);
        let Some(slot) = self.slots.get_mut(index) else { return };
        slot.removed = true;
        if !matches!(slot.state, State::Alive(_)) {
            slot.enter(State::Stopped, "removed", index, actions);
        }
    }

    fn change(&mut self, index: usize, service: Service, now: Time, actions: &mut Vec<Action>) {
        let Some(slot) = self.slots.get_mut(index) else { return };
        let (change, _) = slot.difference(&service);
        // The old start stays in force until the swap is done.
        let present = std::mem::replace(&mut slot.service, service).start;
        let start = std::mem::replace(&mut slot.service.start, present);
        match change {
            Change::Swapped => self.swap(index, start, now, actions),
            Change::Added | Change::Restarted => {
                slot.service.start = start;
                slot.removed = false;
                self.restart(index, now, actions);
            }
            _ if slot.starts == 0 => slot.service.start = start,
            // The file has the start in force again: cancel the swap that would change it.
            _ if slot.service.start == start && slot.target_start() != Some(&start) => {
                self.cancel_before_handover(index, "the launch file has the present executable again", now, actions);
            }
            _ => {}
        }
    }
}

impl Slot {
    /// The change to this service, and the number of its swap.
    fn difference(&self, service: &Service) -> (Change, u64) {
        let rest = |s: &Service| (s.after.clone(), s.policy.clone());
        let in_place = if rest(&self.service) == rest(service) { Change::Unchanged } else { Change::InPlace };
        if self.removed {
            (Change::Added, 0)
        } else if self.service.role != service.role {
            (Change::Restarted, 0)
        } else if self.target_start() == Some(&service.start) {
            (in_place, 0)
        } else if self.starts == 0 || (self.service.start == service.start && !self.hands_over()) {
            // Nothing has to be replaced, or cancelling a swap suffices.
            (Change::InPlace, 0)
        } else {
            (Change::Swapped, self.next_swap())
        }
    }

    /// The start that will be in force after all running swaps.
    fn target_start(&self) -> Option<&Start> {
        if let Some(pending) = &self.next {
            return Some(&pending.start);
        }
        let candidate = self.candidate.as_ref().filter(|n| !matches!(n.stage, Stage::Stopping { .. }));
        let promoting = self.main().filter(|p| matches!(p.stage, Stage::Promoting { .. }));
        candidate.or(promoting).map(|p| &p.start).or(Some(&self.service.start))
    }

    /// Number of the next swap.
    pub(super) fn next_swap(&self) -> u64 {
        self.swap.as_ref().map_or(1, |s| s.number + 1)
    }
}
