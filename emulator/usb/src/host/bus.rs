//! Which transaction is on the bus, how long it takes, and what it brings.

use super::{Host, Transaction, MS, SILENT_TRIES};
use crate::core::{Core, Handshake, InResponse};

/// Overhead of a transaction in bytes (USB 2.0 table 5-9, full speed bulk).
const OVERHEAD: u64 = 13;
/// Interval of the notification pipe.
const NOTIFY_NS: u64 = 255 * MS;

/// Time on the bus of a transaction with `bytes` of payload, at 12 Mbit/s.
const fn duration_ns(bytes: usize) -> u64 {
    (OVERHEAD + bytes as u64) * 8_000 / 12
}

impl Host {
    /// When something happens on a bus that runs.
    pub(super) fn next_transaction(&self, core: &Core) -> Option<u64> {
        if let Some((_, end)) = self.flight {
            return Some(end);
        }
        if self.has_next() {
            return Some(self.now);
        }
        let possible = self.choose(core).map(|_| self.busy_until.max(self.now));
        let deadline = self
            .transfer
            .as_ref()
            .map(|transfer| transfer.deadline().max(self.now));
        let notify = self.device.is_some().then(|| self.notify_at.max(self.now));
        [possible, deadline, notify].into_iter().flatten().min()
    }

    /// The transaction that would come next: control before the others, bulk pipes in turn.
    fn choose(&self, core: &Core) -> Option<Transaction> {
        if let Some(transfer) = &self.transfer {
            if transfer.is_ready(core, self.address) {
                return Some(Transaction::Control);
            }
        }
        if !self.open {
            return None;
        }
        let out = self.to_device.front().is_some_and(|packet| {
            !self.bulk_out.halted
                && core.responds_out(self.address, self.bulk_out.number, packet.len())
        });
        let into = self.reading
            && !self.bulk_in.halted
            && core.responds_in(self.address, self.bulk_in.number);
        match (out, into) {
            (true, true) if self.last_in => Some(Transaction::BulkOut),
            (_, true) => Some(Transaction::BulkIn),
            (true, false) => Some(Transaction::BulkOut),
            (false, false) => None,
        }
    }

    pub(super) fn step_running(&mut self, core: &mut Core) {
        if let Some((transaction, _)) = self.flight.take() {
            self.busy_until = self.now;
            return self.perform(core, transaction);
        }
        if self.has_next() {
            return self.start_next(core);
        }
        if self
            .transfer
            .as_ref()
            .is_some_and(|transfer| self.now >= transfer.deadline())
        {
            return self.finish(core, super::Outcome::TimedOut);
        }
        if self.device.is_some() && self.now >= self.notify_at {
            self.notify_at = self.now + NOTIFY_NS;
            self.flight = Some((
                Transaction::Notification,
                self.now.max(self.busy_until) + duration_ns(0),
            ));
            return;
        }
        if let Some(transaction) = self.choose(core) {
            let bytes = match transaction {
                Transaction::Control => self
                    .transfer
                    .as_ref()
                    .map_or(0, |transfer| transfer.bytes()),
                Transaction::BulkOut => self.to_device.front().map_or(0, Vec::len),
                Transaction::BulkIn => self.bulk_in.max_packet,
                Transaction::Notification => 0,
            };
            self.flight = Some((transaction, self.now + duration_ns(bytes)));
        }
    }

    fn perform(&mut self, core: &mut Core, transaction: Transaction) {
        match transaction {
            Transaction::Control => {
                let address = self.address;
                let ended = self
                    .transfer
                    .as_mut()
                    .and_then(|transfer| transfer.transact(core, address));
                if let Some(outcome) = ended {
                    self.finish(core, outcome);
                }
            }
            Transaction::BulkOut => self.bulk_out(core),
            Transaction::BulkIn => self.bulk_in(core),
            Transaction::Notification => {
                // The port has no notifications to send; what comes is acknowledged and dropped.
                if let InResponse::Data { bytes, .. } =
                    core.in_token(self.address, self.notify.number)
                {
                    core.acknowledged(self.notify.number, bytes.len());
                }
            }
        }
    }

    fn bulk_out(&mut self, core: &mut Core) {
        self.last_in = false;
        let Some(packet) = self.to_device.front() else {
            return;
        };
        let pipe = &mut self.bulk_out;
        match core.out(self.address, pipe.number, pipe.data1, packet) {
            Handshake::Ack => {
                pipe.data1 = !pipe.data1;
                pipe.silent = 0;
                self.counts.packets_out += 1;
                self.counts.bytes_out += packet.len() as u64;
                self.to_device.pop_front();
            }
            Handshake::Nak => {}
            Handshake::Stall => {
                pipe.halted = true;
                self.note("the OUT pipe is stalled".to_owned());
            }
            Handshake::Silence => {
                pipe.silent += 1;
                if pipe.silent >= SILENT_TRIES {
                    pipe.halted = true;
                    self.note("the OUT pipe does not answer".to_owned());
                }
            }
        }
    }

    fn bulk_in(&mut self, core: &mut Core) {
        self.last_in = true;
        let pipe = &mut self.bulk_in;
        match core.in_token(self.address, pipe.number) {
            InResponse::Data { data1, bytes } => {
                core.acknowledged(pipe.number, bytes.len());
                pipe.silent = 0;
                if data1 != pipe.data1 {
                    self.counts.repeated_in += 1;
                    return;
                }
                pipe.data1 = !pipe.data1;
                self.counts.packets_in += 1;
                self.counts.bytes_in += bytes.len() as u64;
                self.counts.empty_in += u64::from(bytes.is_empty());
                self.from_device.extend(bytes);
            }
            InResponse::Nak => {}
            InResponse::Stall => {
                pipe.halted = true;
                self.note("the IN pipe is stalled".to_owned());
            }
            InResponse::Silence => {
                pipe.silent += 1;
                if pipe.silent >= SILENT_TRIES {
                    pipe.halted = true;
                    self.note("the IN pipe does not answer".to_owned());
                }
            }
        }
    }
}
