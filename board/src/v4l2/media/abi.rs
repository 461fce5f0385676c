//! The kernel's structures of media devices, as `linux/media.h` has them.

plain! {
    /// `struct media_v2_entity`.
    Entity(96, 96) {
        /// Number of the entity.
        id: u32,
        /// Name, ends with NUL.
        name: [u8; 64],
        /// [`SENSOR`], [`VIDEO`] and others.
        function: u32,
        /// Flags.
        flags: u32,
        /// Zero.
        reserved: [u32; 5],
    }
}

plain! {
    /// `struct media_v2_interface` of a device node.
    Interface(112, 112) {
        /// Number of the interface.
        id: u32,
        /// Kind of node.
        kind: u32,
        /// Flags.
        flags: u32,
        /// Zero.
        reserved: [u32; 9],
        /// Device number of the node, major and minor.
        device: [u32; 2],
        /// The rest of the union.
        rest: [u32; 14],
    }
}

plain! {
    /// `struct media_v2_pad`.
    Pad(32, 32) {
        /// Number of the pad in the device.
        id: u32,
        /// Number of its entity.
        entity: u32,
        /// [`PAD_SINK`] or [`PAD_SOURCE`].
        flags: u32,
        /// Number of the pad in its entity.
        index: u32,
        /// Zero.
        reserved: [u32; 4],
    }
}

plain! {
    /// `struct media_v2_link`.
    Link(40, 40) {
        /// Number of the link.
        id: u32,
        /// Number of a pad or an interface.
        source: u32,
        /// Number of a pad or an entity.
        sink: u32,
        /// [`LINK_ENABLED`] and others.
        flags: u32,
        /// Zero.
        reserved: [u32; 6],
    }
}

plain! {
    /// `struct media_v2_topology`.
    Counts(72, 72) {
        /// Changes with the graph.
        version: u64,
        /// Entities: number, zero.
        entities: [u32; 2],
        /// Address of the entities, or 0.
        entities_at: u64,
        /// Interfaces: number, zero.
        interfaces: [u32; 2],
        /// Address of the interfaces, or 0.
        interfaces_at: u64,
        /// Pads: number, zero.
        pads: [u32; 2],
        /// Address of the pads, or 0.
        pads_at: u64,
        /// Links: number, zero.
        links: [u32; 2],
        /// Address of the links, or 0.
        links_at: u64,
    }
}

plain! {
    /// `struct media_pad_desc`.
    LinkEnd(20, 20) {
        /// Number of the entity.
        entity: u32,
        /// Number of the pad in its entity.
        index: u16,
        /// Zero.
        gap: u16,
        /// Flags.
        flags: u32,
        /// Zero.
        reserved: [u32; 2],
    }
}

plain! {
    /// `struct media_link_desc`.
    LinkSetup(52, 52) {
        /// Source pad of the link.
        source: LinkEnd = LinkEnd::default(),
        /// Sink pad of the link.
        sink: LinkEnd = LinkEnd::default(),
        /// [`LINK_ENABLED`] or 0.
        flags: u32,
        /// Zero.
        reserved: [u32; 2],
    }
}

/// `MEDIA_ENT_F_CAM_SENSOR`.
pub const SENSOR: u32 = 0x0002_0001;
/// `MEDIA_ENT_F_IO_V4L`: a node that captures.
pub const VIDEO: u32 = 0x0001_0001;
/// `MEDIA_PAD_FL_SINK`.
pub const PAD_SINK: u32 = 1;
/// `MEDIA_PAD_FL_SOURCE`.
pub const PAD_SOURCE: u32 = 2;
/// `MEDIA_LNK_FL_ENABLED`.
pub const LINK_ENABLED: u32 = 1;
/// `MEDIA_LNK_FL_IMMUTABLE`.
pub const LINK_IMMUTABLE: u32 = 2;
/// `MEDIA_LNK_FL_LINK_TYPE`: the bits that tell a link's type.
pub const LINK_TYPE: u32 = 0xf000_0000;
/// `MEDIA_LNK_FL_DATA_LINK`: from pad to pad.
pub const LINK_DATA: u32 = 0;
/// `MEDIA_LNK_FL_INTERFACE_LINK`: from a device node to its entity.
pub const LINK_INTERFACE: u32 = 0x1000_0000;
