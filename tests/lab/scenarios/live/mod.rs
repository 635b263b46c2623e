//! A venue that runs live, and what can happen to it: nodes that are killed, links that are cut, clocks
//! that are wrong, cameras that fail, bytes that nobody should send.
//!
//! Every scenario starts real nodes behind our own relays (see `farfield_lab::live_venue`), waits
//! until everybody is tracked, does its mischief, and looks whether the others went on, whether it is
//! said by name, and whether anything is left over. Waiting ends when something is so; how long that
//! takes is the machine's affair.

mod cameras;
mod clocks;
mod edges;
mod edits;
mod fusion;
mod hostile;
mod joined;
mod links;
mod page;
mod passwords;
mod recording;
mod stage;
mod thumbnails;
