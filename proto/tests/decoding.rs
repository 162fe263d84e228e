//! Decoding of arbitrary bytes ends with a message or an error.

#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

use proptest::prelude::*;

proptest! {
    #![proptest_config(ProptestConfig { cases: 4000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn arbitrary_bytes_are_decoded_or_refused(
        name in proptest::sample::select(sg_proto::message_names()),
        bytes in proptest::collection::vec(any::<u8>(), 0..200),
    ) {
        if let Ok(first) = sg_proto::recode(name, &bytes).unwrap() {
            // A decoded message has one encoding, and decodes again without loss.
            let second = sg_proto::recode(name, &first).unwrap();
            prop_assert_eq!(second, Ok(first));
        }
    }
}

#[test]
fn endless_nesting_is_refused() {
    // No message contains itself, so groups of an unknown field replace hostile nesting.
    let depth = 10_000;
    let bytes = [vec![0x7b_u8; depth], vec![0x7c_u8; depth]].concat();
    for name in sg_proto::message_names() {
        assert!(sg_proto::recode(name, &bytes).unwrap().is_err(), "{name}");
    }
}

#[test]
fn an_unknown_name_differs_from_malformed_bytes() {
    assert_eq!(sg_proto::recode("supergaussian.bus.v1.NoSuchMessage", &[]), None);
    assert!(sg_proto::recode("supergaussian.bus.v1.Error", &[0x12, 0x05, b'a']).unwrap().is_err());
}
