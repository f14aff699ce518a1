//! The most stack that the image can take, from its call graph.
//!
//! The superloop, above it one interrupt of each level, the lower level first, above them the NMI,
//! and what the processor puts on the stack for each. HardFault starts a stack of its own. Code
//! behind a panic is left out: a panic ends the run, pulls the DACs' RST first, and if its message
//! does not fit the HardFault follows, whose record says so.

use std::collections::BTreeMap;

use super::calls::Calls;

/// What an exception puts on the stack: 26 words with the floating-point registers (PM0253 section
/// 2.4.7, figure 12), and 4 bytes to align it.
pub const EXCEPTION: u32 = 26 * 4 + 4;

/// Deepest ways through a graph. Functions that can call each other by some way are one node with
/// the stack of all of them: each counts once.
pub struct Depths<'a> {
    calls: &'a Calls,
    /// Where the search ends: nothing behind it counts.
    end: u32,
    /// Depth of each function that is done.
    known: BTreeMap<u32, u32>,
    /// Functions of more than one member of a node.
    pub recursive: Vec<u32>,
    /// Tarjan's algorithm: order of the visit, and the functions whose node is open.
    order: BTreeMap<u32, usize>,
    open: Vec<u32>,
}

impl<'a> Depths<'a> {
    /// Depths in `calls`; nothing behind `end` counts.
    pub fn new(calls: &'a Calls, end: u32) -> Self {
        Self {
            calls,
            end,
            known: BTreeMap::from([(end, 0)]),
            recursive: Vec::new(),
            order: BTreeMap::new(),
            open: Vec::new(),
        }
    }

    /// The most bytes of stack that a call of the function at `address` takes.
    pub fn of(&mut self, address: u32) -> u32 {
        if !self.known.contains_key(&address) {
            self.visit(address);
        }
        self.known.get(&address).copied().unwrap_or(0)
    }

    /// Visits `at`; returns the lowest order that it can reach.
    fn visit(&mut self, at: u32) -> usize {
        let own = self.order.len();
        self.order.insert(at, own);
        self.open.push(at);
        let mut lowest = own;
        for to in self.next(at) {
            if self.known.contains_key(&to) {
                continue;
            }
            lowest = lowest.min(match self.order.get(&to) {
                Some(order) => *order,
                None => self.visit(to),
            });
        }
        if lowest == own {
            let begin = self.open.iter().position(|open| *open == at).unwrap_or(0);
            let node = self.open.split_off(begin);
            self.close(&node);
        }
        lowest
    }

    fn next(&self, at: u32) -> Vec<u32> {
        if at == self.end {
            return Vec::new();
        }
        self.calls.next(at).collect()
    }

    fn close(&mut self, node: &[u32]) {
        let behind = node.iter().flat_map(|at| self.next(*at));
        let deepest = behind.filter_map(|to| self.known.get(&to)).max();
        let takes = |at: &u32| self.calls.functions.get(at).map_or(0, |f| f.takes);
        let depth = node.iter().map(takes).sum::<u32>() + deepest.copied().unwrap_or(0);
        self.known.extend(node.iter().map(|at| (*at, depth)));
        if node.len() > 1 || node.iter().any(|at| self.next(*at).contains(at)) {
            self.recursive.extend(node);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_deepest_way_counts_and_panics_do_not() {
        let calls = Calls::of(&[
            ("main", 100, &["a", "b"]),
            ("a", 10, &["c"]),
            ("b", 30, &["panic"]),
            ("c", 50, &[]),
            ("panic", 1_000, &[]),
        ]);
        let mut depths = Depths::new(&calls, calls.find("panic").unwrap());
        assert_eq!(depths.of(calls.find("main").unwrap()), 160);
        assert!(depths.recursive.is_empty());
    }

    #[test]
    fn functions_that_call_each_other_count_once_each_and_are_named() {
        let calls = Calls::of(&[
            ("main", 8, &["a", "b"]),
            ("a", 16, &["b"]),
            ("b", 4, &["a", "c"]),
            ("c", 32, &[]),
        ]);
        let mut depths = Depths::new(&calls, 0);
        assert_eq!(depths.of(calls.find("main").unwrap()), 8 + 16 + 4 + 32);
        let mut recursive = depths.recursive.clone();
        recursive.sort_unstable();
        assert_eq!(recursive, ["a", "b"].map(|name| calls.find(name).unwrap()));
    }
}
