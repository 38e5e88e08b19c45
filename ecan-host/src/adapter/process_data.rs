//! The process images of the slaves: raw PDO access (manual 15.5.3).

use super::Adapter;

impl Adapter {
    /// The RxPDO of a slave, written by the application: 128 * N continuous bytes.
    ///
    /// Real-time safe. Empty before activation and for an index out of range. What is written
    /// between [`receive`](Self::receive) and [`send`](Self::send) goes out with that send.
    #[inline]
    pub fn rx_pdo_mut(&mut self, slave: usize) -> &mut [u8] {
        let Some(slave) = self.slaves.get(slave) else { return &mut [] };
        self.master.image_mut(slave.rx)
    }

    /// The current RxPDO image. Real-time safe; empty as above.
    #[inline]
    pub fn rx_pdo(&self, slave: usize) -> &[u8] {
        let Some(slave) = self.slaves.get(slave) else { return &[] };
        self.master.image(slave.rx)
    }

    /// The TxPDO of a slave as of the last [`receive`](Self::receive): 128 * N continuous bytes.
    ///
    /// Real-time safe. Empty before activation and for an index out of range. An image that was
    /// not exchanged keeps its old content: see [`domain_report`](Self::domain_report) and the
    /// sequence in its header.
    #[inline]
    pub fn tx_pdo(&self, slave: usize) -> &[u8] {
        let Some(slave) = self.slaves.get(slave) else { return &[] };
        self.master.image(slave.tx)
    }
}
