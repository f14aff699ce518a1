//! The robot's PLC as far as the board sees it: it gives the amplifiers their power only while the
//! board's alive line toggles and the E-stop loop is closed.
//!
//! The thesis's cell has the PLC watch a toggling line, so that a controller that hangs with the
//! line at either level loses its motors. The limits here are the PLC's of this rig, stated once.

/// Power goes off this long after the last edge, in nanoseconds.
pub const TIMEOUT_NS: u64 = 10_000_000;
/// Gaps between edges that count as toggling, in nanoseconds: 0.2 to 5 ms (the board toggles every
/// 1 ms).
pub const GAP_NS: std::ops::RangeInclusive<u64> = 200_000..=5_000_000;
/// Good edges in a row before power goes on.
pub const EDGES_TO_START: u32 = 10;

/// The PLC.
#[derive(Debug, Clone, Default)]
pub struct Plc {
    last_edge_ns: Option<u64>,
    good_edges: u32,
    edges: u64,
    first_edge_ns: Option<u64>,
    closed: bool,
    powered: bool,
}

impl Plc {
    /// The alive line changed level at `t_ns`.
    pub fn edge(&mut self, t_ns: u64) {
        self.advance(t_ns);
        let good = self
            .last_edge_ns
            .is_some_and(|last| GAP_NS.contains(&(t_ns - last)));
        self.good_edges = if good { self.good_edges + 1 } else { 0 };
        if self.last_edge_ns.is_some() && !good {
            self.powered = false;
        }
        self.last_edge_ns = Some(t_ns);
        self.first_edge_ns.get_or_insert(t_ns);
        self.edges += 1;
        self.decide();
    }

    /// The E-stop loop closed (may run) or opened.
    pub fn set_estop_closed(&mut self, closed: bool) {
        self.closed = closed;
        self.decide();
    }

    /// Whether the E-stop loop is closed.
    #[must_use]
    pub const fn estop_closed(&self) -> bool {
        self.closed
    }

    /// Time passes; a line that stopped toggling loses its power.
    pub fn advance(&mut self, t_ns: u64) {
        if self.deadline().is_some_and(|deadline| t_ns >= deadline) {
            self.good_edges = 0;
            self.powered = false;
        }
    }

    /// When power goes off unless an edge comes, while it is on.
    #[must_use]
    pub fn deadline(&self) -> Option<u64> {
        self.powered
            .then(|| self.last_edge_ns.map(|last| last + TIMEOUT_NS))
            .flatten()
    }

    /// Whether the amplifiers have power.
    #[must_use]
    pub const fn powered(&self) -> bool {
        self.powered
    }

    /// Mean frequency of the alive line in hertz (two edges a period) since its first edge.
    #[must_use]
    pub fn alive_hz(&self) -> f64 {
        match (self.first_edge_ns, self.last_edge_ns) {
            (Some(first), Some(last)) if last > first => {
                (self.edges - 1) as f64 / 2.0 / ((last - first) as f64 * 1e-9)
            }
            _ => 0.0,
        }
    }

    fn decide(&mut self) {
        self.powered = self.closed && (self.powered || self.good_edges >= EDGES_TO_START);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn toggling(plc: &mut Plc, from_ns: u64, edges: u64, gap_ns: u64) -> u64 {
        for k in 0..edges {
            plc.edge(from_ns + k * gap_ns);
        }
        from_ns + (edges - 1) * gap_ns
    }

    #[test]
    fn power_needs_a_toggling_line_and_a_closed_loop() {
        let mut plc = Plc::default();
        let last = toggling(&mut plc, 0, 20, 1_000_000);
        assert!(!plc.powered(), "the loop is open");
        plc.set_estop_closed(true);
        assert!(plc.powered());
        assert!((plc.alive_hz() - 500.0).abs() < 1e-9);
        plc.advance(last + TIMEOUT_NS - 1);
        assert!(plc.powered());
        plc.advance(last + TIMEOUT_NS);
        assert!(!plc.powered());
        plc.edge(last + TIMEOUT_NS + 1);
        assert!(!plc.powered(), "one edge is not toggling");
    }

    #[test]
    fn opening_the_loop_takes_the_power_at_once() {
        let mut plc = Plc::default();
        plc.set_estop_closed(true);
        toggling(&mut plc, 0, 20, 1_000_000);
        plc.set_estop_closed(false);
        assert!(!plc.powered());
    }

    #[test]
    fn a_line_that_chatters_is_not_alive() {
        let mut plc = Plc::default();
        plc.set_estop_closed(true);
        toggling(&mut plc, 0, 1000, 10_000);
        assert!(!plc.powered());
    }
}
