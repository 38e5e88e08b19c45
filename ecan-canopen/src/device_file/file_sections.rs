//! Sections about the file, the device and its commissioning (CiA 306-1, 6.4, 6.5, 7.3.5 and 8.3).

use alloc::string::String;

use crate::NodeId;

use super::section_fields::{BitRates, section_struct};

section_struct! {
    /// The section `[FileInfo]`.
    FileInfo {
        /// Name of the file.
        file_name: String = "FileName",
        /// Version of the file.
        file_version: String = "FileVersion",
        /// Revision of the file.
        file_revision: String = "FileRevision",
        /// Version of CiA 306, for example `4.0`.
        eds_version: String = "EDSVersion",
        /// Description of the file.
        description: String = "Description",
        /// Time of creation, for example `09:45AM`.
        creation_time: String = "CreationTime",
        /// Date of creation as month-day-year, for example `12-31-2024`.
        creation_date: String = "CreationDate",
        /// Author.
        created_by: String = "CreatedBy",
        /// Time of the last change.
        modification_time: String = "ModificationTime",
        /// Date of the last change.
        modification_date: String = "ModificationDate",
        /// Author of the last change.
        modified_by: String = "ModifiedBy",
        /// Name of the EDS from which a DCF was made.
        last_eds: String = "LastEDS",
    }
}

section_struct! {
    /// The section `[DeviceInfo]`.
    DeviceInfo {
        /// Name of the vendor.
        vendor_name: String = "VendorName",
        /// Vendor-ID (0x1018:01).
        vendor_number: Option<u32> = "VendorNumber",
        /// Name of the product.
        product_name: String = "ProductName",
        /// Product code (0x1018:02).
        product_number: Option<u32> = "ProductNumber",
        /// Revision number (0x1018:03).
        revision_number: Option<u32> = "RevisionNumber",
        /// Order code.
        order_code: String = "OrderCode",
        /// Supported bit rates.
        bit_rates: BitRates = "BaudRate_",
        /// True if the device is a simple boot-up master.
        simple_boot_up_master: Option<bool> = "SimpleBootUpMaster",
        /// True if the device is a simple boot-up slave.
        simple_boot_up_slave: Option<bool> = "SimpleBootUpSlave",
        /// Granularity of the PDO mapping in bits; 0 if the mapping is fixed.
        granularity: Option<u8> = "Granularity",
        /// Number of dynamically creatable channels (CiA 302-4).
        dynamic_channels_supported: Option<u8> = "DynamicChannelsSupported",
        /// Sub-objects of PDO communication objects that are described in short form.
        compact_pdo: Option<u16> = "CompactPDO",
        /// True if the device supports group messaging.
        group_messaging: Option<bool> = "GroupMessaging",
        /// Number of receive PDOs.
        receive_pdos: Option<u16> = "NrOfRXPDO",
        /// Number of transmit PDOs.
        transmit_pdos: Option<u16> = "NrOfTXPDO",
        /// True if the device supports LSS (CiA 305).
        lss_supported: Option<bool> = "LSS_Supported",
    }
}

section_struct! {
    /// The section `[DeviceComissioning]` of a DCF, in the spelling of the standard.
    Commissioning {
        /// Node-ID of the device.
        node_id: Option<NodeId> = "NodeID",
        /// Name of the node.
        node_name: String = "NodeName",
        /// Reference designation of the node.
        node_reference: String = "NodeRefd",
        /// Bit rate in kbit/s.
        bit_rate_kbit: Option<u16> = "Baudrate",
        /// Number of the network.
        net_number: Option<u32> = "NetNumber",
        /// Name of the network.
        network_name: String = "NetworkName",
        /// Reference designation of the network.
        network_reference: String = "NetRefd",
        /// True if the node is the CANopen manager.
        is_manager: Option<bool> = "CANopenManager",
        /// Serial number for LSS (0x1018:04).
        lss_serial_number: Option<u32> = "LSS_SerialNumber",
    }
}

section_struct! {
    /// The section `[MxModuleInfo]`: a module that a modular device supports.
    ModuleInfo {
        /// Name of the module.
        product_name: String = "ProductName",
        /// Version of the module.
        product_version: String = "ProductVersion",
        /// Revision of the module.
        product_revision: String = "ProductRevision",
        /// Order code.
        order_code: String = "OrderCode",
    }
}

section_struct! {
    /// A section `[Toolx]`: a program for the device.
    Tool {
        /// Name of the program.
        name: String = "Name",
        /// Command line.
        command: String = "Command",
    }
}
