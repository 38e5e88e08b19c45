use super::declare::variants;
use super::{Alternative, Variant, VariantTable};

variants! {
    choices {
        node_modes: NodeModes, ["H9"], "Numbers of the node modes in 0x8001:08" {
            Manual = "manual", "1 is listen-only, 2 internal loopback, 3 external loopback";
            LoopbackFirst = "loopback_first",
                "1 is internal loopback, 2 external loopback, 3 listen-only";
        }
        repeated_image: RepeatedImage, ["H5"], "Effect of an RxPDO image that repeats the last one" {
            NoOp = "no_op", "none";
            CountedAsError = "error_10", "PDO error 10, counted in 0x8011:15; its frames are not sent again";
        }
    }
    values {}
}
