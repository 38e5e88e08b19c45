//! Other masters on simulated gateways; see the tests.
