*** Settings ***
Documentation     The USB port: a host enumerates the board, opens the port and commands it; cable, bus reset, suspend, both links.
Library           ForceBoard.py

*** Variables ***
# 2,000,000 baud, 8N1, as the host has set it.
${CODING}         80841e00000008

*** Keywords ***
Open Port
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    Use USB

*** Test Cases ***
A Host Enumerates The Board And Opens Its Port
    Create Log Tester    0
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    ${device}=    Descriptor    device
    Should Be Equal As Integers    ${device}[0]    18
    # 1209:0001, class 2, 8 bytes at endpoint 0.
    Should Be Equal    ${{bytes($device[4:12]).hex()}}    0200000809120100
    ${configuration}=    Descriptor    configuration
    Should Be Equal As Integers    ${{$configuration[2] | $configuration[3] << 8}}    ${{len($configuration)}}
    ${text}=    Descriptor    string2
    Should Be Equal    ${{bytes($text[2:]).decode('utf-16-le')}}    force board
    Use USB
    ${hello}=    Connect
    Should Be Equal As Integers    ${hello}[core_hz]    400000000
    Should Not Be In Log    (?i)usb.*(FIFO|endpoint|unhandled)    treatAsRegex=True    level=Warning

Wrong Requests Are Refused And Change Nothing
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    # A descriptor that is not there, a configuration that is not there, a class request that is not there.
    Control Transfer Should End    stalled    0x80    6    0x0900    0    18
    Control Transfer Should End    stalled    0x00    9    7    0    0
    Control Transfer Should End    stalled    0xA1    0x66    0    0    4
    Control Transfer Should End    done.*    0x80    6    0x0100    0    18
    Use USB
    Connect

Every Standard Request Of Chapter 9 Is Answered
    Open Port
    # GET_STATUS of device (self-powered), interface and an endpoint; GET_CONFIGURATION; GET_INTERFACE.
    Control Transfer Should End    done 0100    0x80    0    0    0    2
    Control Transfer Should End    done 0000    0x81    0    0    0    2
    Control Transfer Should End    done 01    0x80    8    0    0    1
    Control Transfer Should End    done 00    0x81    10    0    1    1
    Control Transfer Should End    done    0x02    3    0    0x82    0
    Control Transfer Should End    done 0100    0x82    0    0    0x82    2
    Control Transfer Should End    done    0x02    1    0    0x82    0
    Control Transfer Should End    done 0000    0x82    0    0    0x82    2
    Connect

Wrong Class Requests Are Refused And Change Nothing
    Open Port
    # Unknown; to the wrong interface; line coding too short and read too short; vendor; standard but unknown.
    Control Transfer Should End    stalled    0x21    0x55    0    0    0
    Control Transfer Should End    stalled    0x21    0x20    0    1    7    ${CODING}
    Control Transfer Should End    stalled    0x21    0x20    0    0    3    80841E
    Control Transfer Should End    stalled    0xA1    0x21    0    0    3
    Control Transfer Should End    stalled    0x40    1    0    0    3    010203
    Control Transfer Should End    stalled    0xC0    1    0    0    64
    Control Transfer Should End    stalled    0x00    0x33    0    0    0
    # Device qualifier, other speed, a second configuration, string 99.
    Control Transfer Should End    stalled    0x80    6    0x0600    0    10
    Control Transfer Should End    stalled    0x80    6    0x0700    0    9
    Control Transfer Should End    stalled    0x80    6    0x0201    0    9
    Control Transfer Should End    stalled    0x80    6    0x0363    0x409    255
    Control Transfer Should End    done ${CODING}    0xA1    0x21    0    0    7
    Connect

A Data Stage Of The Wrong Length Ends And USB Goes On
    Create Log Tester    0
    Open Port
    # As long as the request says, and longer than the device has room for.
    FOR    ${length}    IN    129    512    8    4000
        Control Transfer Should End    stalled    0x21    0x20    0    1    ${length}    ${{'00' * int($length)}}
        Control Transfer Should End    done ${CODING}    0xA1    0x21    0    0    7
    END
    # Shorter and longer than the request says; data for a request that has none.
    FOR    ${length}    ${data}    IN    7    8084    7    ${CODING}0000000000    0    ${CODING}    100    ${{'00' * 64}}
        ${answer}=    Control Transfer Should End    stalled|given up|broken.*    0x21    0x20    0    0    ${length}    ${data}
        Log    ${{len($data) // 2}} bytes where the request says ${length}: ${answer}    console=True
        Control Transfer Should End    done ${CODING}    0xA1    0x21    0    0    7
    END
    Connect
    Should Not Be In Log    (?i)usb.*(FIFO|endpoint|unhandled)    treatAsRegex=True    level=Warning

A SETUP In The Middle Of A Transfer Leaves Nothing Behind
    Open Port
    FOR    ${n}    IN RANGE    20
        Control Transfer Should End    abandoned.*    0x80    6    0x0200    0    255    abandon=24
        Control Transfer Should End    abandoned.*    0x21    0x20    0    0    7    ${CODING}    abandon=7
        Control Transfer Should End    abandoned.*    0x80    6    0x0200    0    255    abandon=0
        Control Transfer Should End    abandoned.*    0x21    0x20    0    0    64    ${{'00' * 64}}    abandon=8
    END
    Control Transfer Should End    done ${CODING}    0xA1    0x21    0    0    7
    Connect

Packets Of Any Length Are One Stream Of Bytes
    Open Port
    Connect
    FOR    ${size}    IN    1    2    3    5    8    13    63    64
        Send In Packets    GetStatus    ${size}
    END
    ${status}=    Status
    Should Be Equal As Integers    ${status}[frames_bad]    0

Data PIDs Start Anew After A Cleared Halt And A Configuration
    Open Port
    Connect
    FOR    ${n}    IN RANGE    5
        # One packet each way, so that the PID is DATA1 every other time.
        Request    GetStatus
        Control Transfer Should End    done    0x02    1    0    0x82    0
        Request    GetStatus
        Control Transfer Should End    done    0x02    1    0    0x01    0
        Request    GetStatus
        Control Transfer Should End    done    0x00    9    1    0    0
    END
    ${repeated}=    Number    usbHost Repeated
    Should Be Equal As Integers    ${repeated}    0

Pipes That Are Halted Stall And Go On After They Are Cleared
    Open Port
    Connect
    Control Transfer Should End    done    0x02    3    0    0x82    0
    Run Keyword And Expect Error    no response*    Ask    GetStatus    within_ms=50
    ${stalls}=    Number    usbHost Stalls
    Should Be Equal As Integers    ${stalls}    1
    Control Transfer Should End    done    0x02    1    0    0x82    0
    Request    GetStatus
    Control Transfer Should End    done    0x02    3    0    0x01    0
    Run Keyword And Expect Error    no response*    Ask    GetStatus    within_ms=50
    ${stalls}=    Number    usbHost Stalls
    Should Be Equal As Integers    ${stalls}    2
    Control Transfer Should End    done    0x02    1    0    0x01    0
    Request    GetStatus
    ${repeated}=    Number    usbHost Repeated
    Should Be Equal As Integers    ${repeated}    0

The Sample Path Does Not Notice What The USB Host Does
    Open Port
    Connect
    Stream    1
    Use Serial
    Connect
    Bring Up Units
    Zero Units
    Arm
    Set Tensions    4    4    4    4    4    4
    Hold For    600
    ${before}=    Status
    Forget Samples
    Hold For    1500
    ${reads}=    Path From DRDY To DAC    the host reads
    Execute Command    usbHost Reading false
    Hold For    100
    Forget Samples
    Hold For    2500
    ${stopped}=    Path From DRDY To DAC    the host does not read
    Execute Command    usbHost Reading true
    Forget Samples
    FOR    ${n}    IN RANGE    25
        # SETUPs without an end, a data stage that is too long, a pipe that is halted for a while.
        Execute Command    usbHost Request 0x80 6 0x0200 0 255 "" 24
        Execute Command    usbHost Request 0x21 0x20 0 1 512 "${{'00' * 512}}"
        Execute Command    usbHost Request 0x21 0x20 0 0 7 "${CODING}" 0
        Execute Command    usbHost Request 0x02 3 0 0x82 0
        Hold For    40
        Execute Command    usbHost Request 0x02 1 0 0x82 0
        Hold For    20
    END
    ${hostile}=    Path From DRDY To DAC    the host sends wrong requests
    ${after}=    Status
    FOR    ${path}    IN    ${stopped}    ${hostile}
        Should Be True    $path[0] < $reads[0] + 10
        Should Be True    $path[1] < $reads[1] + 100
        Should Be True    $path[2] < 1000
    END
    FOR    ${unit}    IN RANGE    6
        Should Be Equal As Integers    ${after}[units][${unit}][missed]    ${before}[units][${unit}][missed]
    END
    Tensions Should Be    4    0.6
    ${stalls}=    Number    usbHost Stalls
    Should Be True    ${stalls} > 20
    Host State Should Be    open
    # The USB port carries whole frames again. What found no room there was counted.
    Use USB
    Connect
    ${status}=    Status
    Should Be True    ${status}[frames_dropped] > 100

A Session Over USB
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    Use USB
    Connect
    Bring Up Units
    Zero Units
    Stream    1
    Arm
    Set Tensions    4    4    4    4    4    4
    Hold For    600
    Forget Samples
    Hold For    1000
    Tensions Should Be    4    0.6
    Frames Should Have No Gap
    Samples Should Be Complete    1000
    Latency Should Agree From Both Ends

A Pulled Cable Stops The Motors And A New Session Holds Again
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    Use USB
    Connect
    Bring Up Units
    Zero Units
    Arm
    Set Tensions    4    4    4    4    4    4
    Hold For    600
    Output Should Drive
    Execute Command    usbHost Plug false
    Advance    150
    Output Should Be Zero
    Host State Should Be    detached
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    Use USB
    Connect
    Board Fault Should Be    setpoints expired
    Request    ClearFaults
    Advance    50
    Arm
    Hold For    600
    Output Should Drive
    Tensions Should Be    4    0.8

Suspend And Resume
    Power Up Board
    Execute Command    usbHost Plug true
    Host State Should Be    open    within_ms=1000
    Use USB
    Connect
    Bring Up Units
    Execute Command    usbHost SuspendBus true
    Advance    100
    Execute Command    usbHost SuspendBus false
    Host State Should Be    open    within_ms=200
    Discard Input
    ${status}=    Status
    Should Be Equal As Integers    ${status}[fault]    0

A Bus Reset At Any Time Ends In An Open Port
    Power Up Board
    Execute Command    usbHost Plug true
    FOR    ${ms}    IN    101    30    41    180    160
        Advance    ${ms}
        Execute Command    usbHost ResetBus
    END
    Host State Should Be    open    within_ms=1000
    Use USB
    Connect
    ${repeated}=    Number    usbHost Repeated
    Should Be Equal As Integers    ${repeated}    0

Set Force Through The Real Controller Over USB
    Power Up Board
    ${figures}=    Run Forcectl    set-force    0    2.5    0    --duration    2    --usb
    Should Be Equal As Integers    ${figures}[samples_lost]    0
    Should Be Equal As Integers    ${figures}[link_counters][frames_bad]    0
    Should Be Empty    ${figures}[faults]
    Should Be True    ${figures}[metrics][tip_force_rms_n] < 0.2
    Should Be True    abs(${figures}[metrics][applied_n][1] - 2.5) < 0.1
    Output Should Be Zero
